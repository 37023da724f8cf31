//! Following a plan: which pose to aim the object at, and the normalised OSC_POSE action that moves it there.
//!
//! The grasp is rigid while a command acts, so moving the object from `T_obj` to `T_target` means moving the end
//! effector from `T_eef` to `T_target T_obj^-1 T_eef`. The action is the difference of these two end-effector poses in the
//! robot's base frame, clipped to the limits of one control step and divided by the controller's output scale.

use crate::error::{Error, Result};
use crate::pose::{
    Matrix3, Pose, Vector3, add, check_rotation, geodesic_angle, multiply, norm, rotate, rotation_log, scale, subtract,
    transpose,
};

/// How a pose difference becomes an action.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeltaPoseLaw {
    /// Factor on the position difference (a constant command u moves the end effector only about 0.31 u a step).
    pub gain_position: f64,
    /// Factor on the rotation vector.
    pub gain_rotation: f64,
    /// Largest horizontal command a step, metres.
    pub limit_horizontal: f64,
    /// Largest vertical command a step, metres; clipped separately, so that a far target does not starve the lift.
    pub limit_vertical: f64,
    /// Largest rotation command a step, radians.
    pub limit_rotation: f64,
    /// The controller's displacement for an action of 1, metres.
    pub scale_position: f64,
    /// The controller's rotation for an action of 1, radians.
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
    ///
    /// # Errors
    /// [`Error::Value`] naming the first that fails.
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
    /// The controller reads its command in the robot's base frame, whose axes are `rotation_world_base`.
    ///
    /// # Errors
    /// [`Error::Value`] if a matrix is not a rotation, or the numbers overflow.
    pub fn action(&self, object: &Pose, target: &Pose, eef: &Pose, rotation_world_base: &Matrix3) -> Result<[f64; 6]> {
        let to_base = transpose(rotation_world_base);
        let turn = multiply(&target.rotation, &transpose(&object.rotation));
        let arm = subtract(&eef.position, &object.position);
        let goal = add(&target.position, &rotate(&turn, &arm));
        let delta_pos_base = scale(&rotate(&to_base, &subtract(&goal, &eef.position)), self.gain_position);
        let delta_rot_base = scale(&rotate(&to_base, &rotation_log(&turn)?), self.gain_rotation);
        let horizontal = shrink(delta_pos_base[0].hypot(delta_pos_base[1]), self.limit_horizontal);
        let vertical = shrink(delta_pos_base[2].abs(), self.limit_vertical);
        let turning = shrink(norm(&delta_rot_base), self.limit_rotation);
        let [x, y, z] = delta_pos_base.map(|v| v / self.scale_position);
        let [a, b, c] = delta_rot_base.map(|v| v / self.scale_rotation * turning);
        let action = [x * horizontal, y * horizontal, z * vertical, a, b, c].map(|v| v.clamp(-1.0, 1.0));
        if action.iter().all(|v| v.is_finite()) {
            return Ok(action);
        }
        Err(Error::Value {
            what: "action",
            found: format!("{action:?}"),
            expected: "finite numbers; the poses are too far apart",
        })
    }
}

/// The factor that shortens a vector of this length to the limit.
fn shrink(length: f64, limit: f64) -> f64 {
    if length > limit { limit / length } else { 1.0 }
}

/// How the target moves along the plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Follow {
    /// The paper's control: differences of consecutive planned poses, regardless of where the object is.
    OpenLoop,
    /// Closed loop on the object's pose, one plan step per control step.
    Time,
    /// Closed loop. Starts at the nearest plan step and advances while the object is within the gate of the target.
    Gated {
        /// Size of the gate, metres.
        position: f64,
        /// Size of the gate, radians.
        rotation: f64,
    },
}

/// Follows one plan at a time. Its state is the plan and the step that is the target.
#[derive(Debug, Clone)]
pub struct DeltaPoseController {
    follow: Follow,
    positions: Vec<Vector3>,
    rotations: Option<Vec<Matrix3>>,
    index: usize,
}

impl DeltaPoseController {
    /// A controller without a plan.
    ///
    /// # Errors
    /// [`Error::Value`] if the gate is not positive.
    pub fn new(follow: Follow) -> Result<Self> {
        if let Follow::Gated { position, rotation } = follow {
            for (what, value) in [("gate_position", position), ("gate_rotation", rotation)] {
                if !(value.is_finite() && value > 0.0) {
                    return Err(Error::Value { what, found: value.to_string(), expected: "a positive number" });
                }
            }
        }
        Ok(Self { follow, positions: Vec::new(), rotations: None, index: 0 })
    }

    /// Takes a new plan, m'_{t+1} ... m'_{t+H}, and starts at its first step or, when gated, at the step nearest to the
    /// object. A plan without rotations leaves the object's rotation alone.
    ///
    /// # Errors
    /// [`Error::Shape`] if the plan is empty or its positions and rotations differ in number; [`Error::Value`] if a number
    /// is not finite or a matrix is not a rotation.
    pub fn set_plan(&mut self, positions: Vec<Vector3>, rotations: Option<Vec<Matrix3>>, object: &Pose) -> Result<()> {
        let shape = |found: Vec<usize>, expected: &str| Error::Shape { what: "plan", found, expected: expected.into() };
        if positions.is_empty() {
            return Err(shape(vec![0, 3], "at least one step"));
        }
        if positions.iter().flatten().any(|value| !value.is_finite()) {
            return Err(Error::Value { what: "plan", found: "NaN or infinity".into(), expected: "finite numbers" });
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
                let (distance, angle) = self.distance(index, object)?;
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
    #[must_use]
    pub fn index(&self) -> usize {
        self.index
    }

    /// Whether a plan has been given.
    #[must_use]
    pub fn has_plan(&self) -> bool {
        !self.positions.is_empty()
    }

    /// Whether the target is the plan's last step.
    #[must_use]
    pub fn at_end(&self) -> bool {
        self.index + 1 >= self.positions.len()
    }

    fn distance(&self, index: usize, object: &Pose) -> Result<(f64, f64)> {
        let distance = norm(&subtract(&self.positions[index], &object.position));
        let angle = match &self.rotations {
            Some(rotations) => geodesic_angle(&rotations[index], &object.rotation)?,
            None => 0.0,
        };
        Ok((distance, angle))
    }

    fn pose(&self, index: usize, object: &Pose) -> Pose {
        let rotation = self.rotations.as_ref().map_or(object.rotation, |r| r[index]);
        Pose { position: self.positions[index], rotation }
    }

    /// Advances along the plan and returns the pose to aim the object at.
    ///
    /// In open loop that is the object's present pose, moved by the difference of two consecutive planned poses.
    ///
    /// # Errors
    /// [`Error::Value`] without a plan.
    pub fn target(&mut self, object: &Pose) -> Result<Pose> {
        let count = self.positions.len();
        if count == 0 {
            return Err(Error::Value { what: "plan", found: "none".into(), expected: "a plan; call set_plan first" });
        }
        match self.follow {
            Follow::OpenLoop => {
                let next = (self.index + 1).min(count - 1);
                let (from, to) = (self.pose(self.index, object), self.pose(next, object));
                self.index = next;
                let step = subtract(&to.position, &from.position);
                let turn = multiply(&to.rotation, &transpose(&from.rotation));
                Ok(Pose { position: add(&object.position, &step), rotation: multiply(&turn, &object.rotation) })
            }
            Follow::Time => {
                let target = self.pose(self.index, object);
                self.index = (self.index + 1).min(count - 1);
                Ok(target)
            }
            Follow::Gated { position, rotation } => {
                while self.index + 1 < count {
                    let (distance, angle) = self.distance(self.index, object)?;
                    if distance >= position || angle >= rotation {
                        break;
                    }
                    self.index += 1;
                }
                Ok(self.pose(self.index, object))
            }
        }
    }
}
