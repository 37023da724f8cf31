//! From the object pose that a plan asks for to a normalised OSC_POSE action.
//!
//! The grasp is rigid while a command acts, so moving the object from `T_obj` to `T_target` means moving the end
//! effector from `T_eef` to `T_target T_obj^-1 T_eef`. The difference of the two end-effector poses, seen from the
//! robot's base, clipped to what a controller step may ask for and divided by the controller's output scale, is the
//! action.

use crate::error::{Error, Result};
use crate::pose::{
    Matrix3, Pose, Vector3, add, check_rotation, geodesic_angle, multiply, norm, rotate, rotation_log, scale, subtract,
    transpose,
};

/// A pose whose numbers are finite and whose rotation is one.
///
/// # Errors
/// [`Error::Value`] if they are not.
pub fn checked_pose(what: &'static str, position: Vector3, rotation: Matrix3) -> Result<Pose> {
    if !position.iter().all(|value| value.is_finite()) {
        return Err(Error::Value { what, found: format!("position {position:?}"), expected: "finite" });
    }
    check_rotation(what, &rotation)?;
    Ok(Pose { position, rotation })
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
    ///
    /// # Errors
    /// [`Error::Value`] naming the first that is not.
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
    ///
    /// # Errors
    /// [`Error::Value`] if a rotation is none, or the numbers overflow.
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
            expected: "finite: the poses lie too far apart",
        })
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
    positions: Vec<Vector3>,
    rotations: Option<Vec<Matrix3>>,
    index: usize,
}

impl DeltaPoseController {
    /// A controller without a plan.
    ///
    /// # Errors
    /// [`Error::Value`] if the law or the gate is not valid.
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

    /// The law of its actions.
    #[must_use]
    pub fn law(&self) -> &DeltaPoseLaw {
        &self.law
    }

    /// Takes a new plan, m'_{t+1} ... m'_{t+H}, and finds where to start: at its first step, or, gated, at the step
    /// nearest to the object. Without rotations the plan is position-only and the object's rotation is left alone.
    ///
    /// # Errors
    /// [`Error::Shape`] if the plan is empty or its halves differ in length, [`Error::Value`] if a number is not
    /// finite or a rotation is none.
    pub fn set_plan(&mut self, positions: Vec<Vector3>, rotations: Option<Vec<Matrix3>>, object: &Pose) -> Result<()> {
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
    pub fn index(&self) -> usize {
        self.index
    }

    /// Whether a plan has been given.
    #[must_use]
    pub fn has_plan(&self) -> bool {
        !self.positions.is_empty()
    }

    /// Whether the target is the plan's last step.
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

    /// Advances along the plan and gives the object pose to aim at.
    ///
    /// Open loop, that is the current pose moved by the difference of two consecutive planned poses.
    ///
    /// # Errors
    /// [`Error::Value`] without a plan.
    pub fn target(&mut self, object: &Pose) -> Result<Pose> {
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

    /// The action toward a target, by the controller's law.
    ///
    /// # Errors
    /// As for [`DeltaPoseLaw::action`].
    pub fn action(&self, object: &Pose, target: &Pose, eef: &Pose, rotation_world_base: &Matrix3) -> Result<[f64; 6]> {
        self.law.action(object, target, eef, rotation_world_base)
    }
}
