//! From the object pose that a plan asks for to a normalised OSC_POSE action.
//!
//! The grasp is rigid while a command acts, so moving the object from `T_obj` to `T_target` means moving the end
//! effector from `T_eef` to `T_target T_obj^-1 T_eef`. The difference of the two end-effector poses, seen from the
//! robot's base, clipped to what a controller step may ask for and divided by the controller's output scale, is the
//! action.

use crate::error::{Error, Result};

type Vector = [f64; 3];
type Matrix = [[f64; 3]; 3];

/// Pose of a body: metres, body -> world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyPose {
    /// Position, metres.
    pub position: Vector,
    /// Rotation matrix, row-major.
    pub rotation: Matrix,
}

impl BodyPose {
    /// Checks that the numbers are finite and the rotation is one (orthonormal and right-handed within 1e-3).
    pub fn new(what: &'static str, position: Vector, rotation: Matrix) -> Result<Self> {
        if !position.iter().all(|value| value.is_finite()) {
            return Err(Error::Value { what, found: format!("position {position:?}"), expected: "finite" });
        }
        check_rotation(what, &rotation)?;
        Ok(Self { position, rotation })
    }
}

/// Checks that a matrix is a rotation within 1e-3.
pub fn check_rotation(what: &'static str, rotation: &Matrix) -> Result<()> {
    let gram = multiply(&transpose(rotation), rotation);
    let mut error: f64 = 0.0;
    for (i, row) in gram.iter().enumerate() {
        for (j, value) in row.iter().enumerate() {
            let wanted = if i == j { 1.0 } else { 0.0 };
            // `max` drops a NaN, so NaN is turned into infinity
            let difference = (value - wanted).abs();
            error = error.max(if difference.is_nan() { f64::INFINITY } else { difference });
        }
    }
    let [a, b, c] = *rotation;
    let determinant =
        a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
    if error > 1e-3 || determinant <= 0.0 {
        return Err(Error::Value { what, found: format!("{rotation:?}"), expected: "a rotation matrix" });
    }
    Ok(())
}

fn transpose(a: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

fn multiply(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

fn apply(a: &Matrix, v: &Vector) -> Vector {
    std::array::from_fn(|i| (0..3).map(|k| a[i][k] * v[k]).sum())
}

fn subtract(a: &Vector, b: &Vector) -> Vector {
    std::array::from_fn(|i| a[i] - b[i])
}

fn norm(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// The rotation vector (axis times angle, angle in [0, pi]) of a rotation matrix.
///
/// Goes through the unit quaternion with a non-negative real part, which is well conditioned at every angle and
/// always takes the short way round.
pub fn rotation_vector(r: &Matrix) -> Vector {
    let trace = r[0][0] + r[1][1] + r[2][2];
    // Shepperd: start from the largest of the four squared components
    let squares = [1.0 + trace, 1.0 + 2.0 * r[0][0] - trace, 1.0 + 2.0 * r[1][1] - trace, 1.0 + 2.0 * r[2][2] - trace];
    let largest = (0..4).max_by(|&i, &j| squares[i].total_cmp(&squares[j])).unwrap_or(0);
    let d = squares[largest].max(0.0).sqrt();
    let (w, v) = match largest {
        0 => (d, [(r[2][1] - r[1][2]) / d, (r[0][2] - r[2][0]) / d, (r[1][0] - r[0][1]) / d]),
        1 => ((r[2][1] - r[1][2]) / d, [d, (r[0][1] + r[1][0]) / d, (r[0][2] + r[2][0]) / d]),
        2 => ((r[0][2] - r[2][0]) / d, [(r[0][1] + r[1][0]) / d, d, (r[1][2] + r[2][1]) / d]),
        _ => ((r[1][0] - r[0][1]) / d, [(r[0][2] + r[2][0]) / d, (r[1][2] + r[2][1]) / d, d]),
    };
    let sign = if w < 0.0 { -1.0 } else { 1.0 };
    let sine = norm(&v);
    if sine < 1e-12 {
        return [0.0; 3];
    }
    let angle = 2.0 * sine.atan2(w * sign);
    v.map(|x| sign * x / sine * angle)
}

/// The angle between two rotations, in [0, pi] radians.
pub fn angle_between(a: &Matrix, b: &Matrix) -> f64 {
    norm(&rotation_vector(&multiply(a, &transpose(b))))
}

/// How a pose difference becomes an action.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeltaPoseLaw {
    /// Factor on the position difference (a constant command u moves only about 0.31 u a step).
    pub gain_position: f64,
    /// Factor on the rotation vector.
    pub gain_rotation: f64,
    /// Largest horizontal command a step, metres.
    pub limit_horizontal: f64,
    /// Largest vertical command a step, metres; clipped apart so that a far target does not starve the lift.
    pub limit_vertical: f64,
    /// Largest rotation command a step, radians.
    pub limit_rotation: f64,
    /// The controller's output for an action of 1, metres.
    pub scale_position: f64,
    /// The controller's output for an action of 1, radians.
    pub scale_rotation: f64,
}

impl Default for DeltaPoseLaw {
    fn default() -> Self {
        Self {
            gain_position: 1.0,
            gain_rotation: 1.0,
            limit_horizontal: 0.05,
            limit_vertical: 0.05,
            limit_rotation: 0.2,
            scale_position: 0.05,
            scale_rotation: 0.5,
        }
    }
}

impl DeltaPoseLaw {
    /// Checks that every gain, limit and scale is finite and positive, and that no limit exceeds its scale.
    pub fn validate(self) -> Result<Self> {
        let positive = [
            ("gain_position", self.gain_position),
            ("gain_rotation", self.gain_rotation),
            ("limit_horizontal", self.limit_horizontal),
            ("limit_vertical", self.limit_vertical),
            ("limit_rotation", self.limit_rotation),
            ("scale_position", self.scale_position),
            ("scale_rotation", self.scale_rotation),
        ];
        for (what, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(Error::Value { what, found: value.to_string(), expected: "a positive number" });
            }
        }
        let bounded = [
            ("limit_horizontal", self.limit_horizontal, self.scale_position),
            ("limit_vertical", self.limit_vertical, self.scale_position),
            ("limit_rotation", self.limit_rotation, self.scale_rotation),
        ];
        for (what, value, scale) in bounded {
            if value > scale {
                return Err(Error::Value { what, found: value.to_string(), expected: "at most the output scale" });
            }
        }
        Ok(self)
    }

    /// The action (dx, dy, dz, rx, ry, rz), each in [-1, 1], that moves `object` toward `target`.
    ///
    /// `rotation_world_base` holds the axes of the robot's base, in which the controller reads its command.
    pub fn action(
        &self,
        object: &BodyPose,
        target: &BodyPose,
        eef: &BodyPose,
        rotation_world_base: &Matrix,
    ) -> [f64; 6] {
        let to_base = transpose(rotation_world_base);
        let turn = multiply(&target.rotation, &transpose(&object.rotation));
        let arm = subtract(&eef.position, &object.position);
        let turned = apply(&turn, &arm);
        let delta: Vector = std::array::from_fn(|i| target.position[i] + turned[i] - eef.position[i]);
        let move_base = apply(&to_base, &delta).map(|x| x * self.gain_position);
        let turn_base = apply(&to_base, &rotation_vector(&turn)).map(|x| x * self.gain_rotation);
        let horizontal = shrink(norm(&move_base[..2]), self.limit_horizontal) / self.scale_position;
        let vertical = shrink(move_base[2].abs(), self.limit_vertical) / self.scale_position;
        let rotation = shrink(norm(&turn_base), self.limit_rotation) / self.scale_rotation;
        let action = [
            move_base[0] * horizontal,
            move_base[1] * horizontal,
            move_base[2] * vertical,
            turn_base[0] * rotation,
            turn_base[1] * rotation,
            turn_base[2] * rotation,
        ];
        action.map(|x| x.clamp(-1.0, 1.0))
    }
}

/// The factor that brings a length down to a limit, keeping the direction.
fn shrink(length: f64, limit: f64) -> f64 {
    if length > limit { limit / length } else { 1.0 }
}

/// Which plan step is the target now.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Follow {
    /// The paper's: differences of consecutive planned poses, blind to where the object is.
    OpenLoop,
    /// Closed loop on the object pose, one plan step a control step.
    Time,
    /// Closed loop; starts at the nearest plan step and advances only while the object is there.
    Gated {
        /// Distance that counts as there, metres.
        position: f64,
        /// Angle that counts as there, radians.
        rotation: f64,
    },
}

/// Follows one plan at a time; the state is the plan and how far along it the object is.
#[derive(Debug, Clone)]
pub struct DeltaPoseController {
    law: DeltaPoseLaw,
    follow: Follow,
    positions: Vec<Vector>,
    rotations: Option<Vec<Matrix>>,
    index: usize,
}

impl DeltaPoseController {
    /// A controller without a plan.
    pub fn new(law: DeltaPoseLaw, follow: Follow) -> Result<Self> {
        if let Follow::Gated { position, rotation } = follow {
            for (what, value) in [("gate_position", position), ("gate_rotation", rotation)] {
                if !(value.is_finite() && value > 0.0) {
                    return Err(Error::Value { what, found: value.to_string(), expected: "a positive number" });
                }
            }
        }
        Ok(Self { law: law.validate()?, follow, positions: Vec::new(), rotations: None, index: 0 })
    }

    /// Takes a new plan, m'_{t+1} ... m'_{t+H}, and finds where to start: at its first step, or, gated, at the step
    /// nearest to the object. Without rotations the plan is position-only and the object's rotation is left alone.
    pub fn set_plan(
        &mut self,
        positions: Vec<Vector>,
        rotations: Option<Vec<Matrix>>,
        object: &BodyPose,
    ) -> Result<()> {
        let shape = |found: Vec<usize>, expected: &str| Error::Shape { what: "plan", found, expected: expected.into() };
        if positions.is_empty() {
            return Err(shape(vec![0, 3], "at least one step"));
        }
        if positions.iter().flatten().any(|value| !value.is_finite()) {
            return Err(Error::Value { what: "plan", found: "NaN or infinity".into(), expected: "finite" });
        }
        if let Some(rotations) = &rotations {
            if rotations.len() != positions.len() {
                return Err(shape(vec![rotations.len(), 3, 3], "as many rotations as positions"));
            }
            for rotation in rotations {
                check_rotation("plan", rotation)?;
            }
        }
        self.positions = positions;
        self.rotations = rotations;
        self.index = 0;
        if let Follow::Gated { position, rotation } = self.follow {
            let mut best = f64::INFINITY;
            for index in 0..self.positions.len() {
                let (distance, angle) = self.distance(index, object);
                let cost = distance / position + angle / rotation;
                if cost < best {
                    best = cost;
                    self.index = index;
                }
            }
        }
        Ok(())
    }

    /// The plan step that is the target now.
    pub fn index(&self) -> usize {
        self.index
    }

    /// Whether the target is the plan's last step.
    pub fn at_end(&self) -> bool {
        self.index + 1 >= self.positions.len()
    }

    fn distance(&self, index: usize, object: &BodyPose) -> (f64, f64) {
        let distance = norm(&subtract(&self.positions[index], &object.position));
        let angle = self.rotations.as_ref().map_or(0.0, |r| angle_between(&r[index], &object.rotation));
        (distance, angle)
    }

    fn pose(&self, index: usize, object: &BodyPose) -> BodyPose {
        let rotation = self.rotations.as_ref().map_or(object.rotation, |r| r[index]);
        BodyPose { position: self.positions[index], rotation }
    }

    /// Advances along the plan and gives the object pose to aim at.
    ///
    /// Open loop, that is the current pose moved by the difference of two consecutive planned poses.
    pub fn target(&mut self, object: &BodyPose) -> Result<BodyPose> {
        let count = self.positions.len();
        if count == 0 {
            return Err(Error::Value { what: "controller", found: "no plan".into(), expected: "given a plan first" });
        }
        match self.follow {
            Follow::OpenLoop => {
                let next = (self.index + 1).min(count - 1);
                let (from, to) = (self.pose(self.index, object), self.pose(next, object));
                self.index = next;
                let step = subtract(&to.position, &from.position);
                let turn = multiply(&to.rotation, &transpose(&from.rotation));
                Ok(BodyPose {
                    position: std::array::from_fn(|i| object.position[i] + step[i]),
                    rotation: multiply(&turn, &object.rotation),
                })
            }
            Follow::Time => {
                let target = self.pose(self.index, object);
                self.index = (self.index + 1).min(count - 1);
                Ok(target)
            }
            Follow::Gated { position, rotation } => {
                while self.index + 1 < count {
                    let (distance, angle) = self.distance(self.index, object);
                    if distance >= position || angle >= rotation {
                        break;
                    }
                    self.index += 1;
                }
                Ok(self.pose(self.index, object))
            }
        }
    }

    /// The action toward a target, by the controller's law.
    pub fn action(
        &self,
        object: &BodyPose,
        target: &BodyPose,
        eef: &BodyPose,
        rotation_world_base: &Matrix,
    ) -> [f64; 6] {
        self.law.action(object, target, eef, rotation_world_base)
    }
}
