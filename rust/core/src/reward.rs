//! Dense rewards from plans (the paper's section 5): how far the object is from where the plan puts it.
//!
//! A transition leads from step t to t + 1. At t the plan says where the object should be next, m'_{t+1}; after the
//! transition it is at m_{t+1}. Two terms measure the difference, each with its own weight:
//!
//! - position, |p' - p|^2 in square metres ([`position_error`]);
//! - rotation, |r' - r|^2 with r the first two columns of the rotation matrix, without unit ([`rotation_error`]).
//!
//! Terms and rewards are zero where the robot does not hold the object, because the planner never saw such frames.

use crate::error::{Error, Result};
use crate::pose::{Matrix3, Vector3, check_rotation, dot, subtract, transpose};

/// Poses of the object in the world frame, one for each transition.
#[derive(Debug, Clone, Copy)]
pub struct Poses<'a> {
    /// Metres.
    pub position: &'a [Vector3],
    /// Object -> world; `None` where only positions are known or planned.
    pub rotation: Option<&'a [Matrix3]>,
}

/// How the weighted error E = a |p' - p|^2 + b |r' - r|^2 of a transition becomes a reward.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Form {
    /// -E: staying on the plan earns the best reward, zero.
    Penalty,
    /// +E: the equation as the paper prints it, which rewards leaving the plan.
    Literal,
    /// exp(-E / scale): 1 on the plan, toward 0 far from it (exactly 0 only by underflow, beyond 745 scales).
    Exp {
        /// The error at which the reward has fallen to 1/e.
        scale: f64,
    },
    /// gamma Phi(s') - Phi(s): shaping that does not change which policy is best (Ng, Harada and Russell 1999).
    ///
    /// Phi of a state is -E of the transition that led to it. It is 0 in an episode's first state, after a transition
    /// without a grasp, and in a terminal state. So a grasp begins with -gamma E, and the first transition after it pays
    /// the last E back. Over an episode that ends in a terminal state the discounted rewards sum to zero whatever
    /// happened, otherwise to gamma^T Phi(s_T).
    Potential {
        /// The learner's discount.
        gamma: f64,
    },
}

/// How an episode ends, in Gymnasium's terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EpisodeEnd {
    /// Its last transition leads to a terminal state.
    Terminated,
    /// A time limit cuts it off.
    Truncated,
}

/// Weights and form of the reward.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RewardLaw {
    /// a, per square metre.
    pub weight_position: f64,
    /// b.
    pub weight_rotation: f64,
    /// How the weighted error becomes a reward.
    pub form: Form,
}

impl Default for RewardLaw {
    fn default() -> Self {
        Self { weight_position: 0.003, weight_rotation: 0.003, form: Form::Penalty }
    }
}

/// Terms and rewards of an episode's transitions.
#[derive(Debug, Clone, PartialEq)]
pub struct Rewards {
    /// (T,) |p' - p|^2, square metres, unweighted.
    pub position: Vec<f64>,
    /// (T,) |r' - r|^2, unweighted; `None` if the plan has no rotations.
    pub rotation: Option<Vec<f64>>,
    /// (T,) the rewards.
    pub reward: Vec<f64>,
}

/// |p' - p|^2, square metres.
///
/// # Errors
/// [`Error::Value`] if a number is not finite, or the square overflows.
pub fn position_error(planned: &Vector3, achieved: &Vector3) -> Result<f64> {
    check_position("planned position", planned)?;
    check_position("achieved position", achieved)?;
    let difference = subtract(planned, achieved);
    finite("position error", dot(&difference, &difference))
}

/// |r' - r|^2, where r is the paper's form of a rotation: the six numbers of its matrix's first two columns.
///
/// For rotations an angle theta apart about the axis n, in the object's frame, this is 2 (1 - cos theta)(1 + n_z^2).
/// Turns about the object's z count as much as in the whole matrix's squared Frobenius norm, 4 (1 - cos theta); turns
/// about x and y count half as much.
///
/// # Errors
/// [`Error::Value`] if a matrix is not a rotation.
pub fn rotation_error(planned: &Matrix3, achieved: &Matrix3) -> Result<f64> {
    check_rotation("planned rotation", planned)?;
    check_rotation("achieved rotation", achieved)?;
    let (planned, achieved) = (transpose(planned), transpose(achieved));
    let column = |i: usize| {
        let difference = subtract(&planned[i], &achieved[i]);
        dot(&difference, &difference)
    };
    Ok(column(0) + column(1))
}

impl RewardLaw {
    /// Checks that the weights are not negative, the scale is positive and the discount lies in [0, 1].
    ///
    /// # Errors
    /// [`Error::Value`] naming the first that fails.
    pub fn validate(self) -> Result<Self> {
        for (what, weight) in [("position weight a", self.weight_position), ("rotation weight b", self.weight_rotation)]
        {
            if !(weight.is_finite() && weight >= 0.0) {
                return Err(Error::Value { what, found: weight.to_string(), expected: "a finite number >= 0" });
            }
        }
        match self.form {
            Form::Exp { scale } if !(scale.is_finite() && scale > 0.0) => {
                Err(Error::Value { what: "scale", found: scale.to_string(), expected: "a positive number" })
            }
            Form::Potential { gamma } if !(0.0..=1.0).contains(&gamma) => {
                Err(Error::Value { what: "gamma", found: gamma.to_string(), expected: "a number between 0 and 1" })
            }
            _ => Ok(self),
        }
    }

    /// Terms and rewards of an episode.
    ///
    /// `planned` and `achieved` hold m'_{t+1} and m_{t+1}; `grasping` says whether the robot holds the object during the
    /// transition. Without planned rotations the achieved ones are ignored and there is no rotation term. `further` is
    /// the weighted error of terms beside these two, which E includes where the object is held; empty for none. Only the
    /// potential form depends on `end`.
    ///
    /// # Errors
    /// [`Error::Shape`] if lengths differ. [`Error::Value`] if a number is not finite, a matrix is not a rotation, or a
    /// reward overflows.
    pub fn rewards(
        &self,
        planned: Poses<'_>,
        achieved: Poses<'_>,
        grasping: &[bool],
        further: &[f64],
        end: EpisodeEnd,
    ) -> Result<Rewards> {
        let steps = grasping.len();
        if !further.is_empty() && further.len() != steps {
            let expected = format!("({steps},): one for each flag of grasping");
            return Err(Error::Shape { what: "further error", found: vec![further.len()], expected });
        }
        same_length("planned position", planned.position.len(), steps, "3")?;
        same_length("achieved position", achieved.position.len(), steps, "3")?;
        let mut position = Vec::with_capacity(steps);
        for (t, held) in grasping.iter().enumerate() {
            let error = position_error(&planned.position[t], &achieved.position[t])?;
            position.push(if *held { error } else { 0.0 });
        }
        let mut rotation = None;
        if let Some(planned) = planned.rotation {
            same_length("planned rotation", planned.len(), steps, "3, 3")?;
            let achieved = achieved.rotation.unwrap_or_default();
            same_length("achieved rotation", achieved.len(), steps, "3, 3")?;
            let turned = rotation.insert(Vec::with_capacity(steps));
            for (t, held) in grasping.iter().enumerate() {
                let error = rotation_error(&planned[t], &achieved[t])?;
                turned.push(if *held { error } else { 0.0 });
            }
        }
        let reward = self.combine(&position, rotation.as_deref(), grasping, further, end)?;
        Ok(Rewards { position, rotation, reward })
    }

    /// Rewards from terms that are zero where nothing is held.
    fn combine(
        &self,
        position: &[f64],
        rotation: Option<&[f64]>,
        grasping: &[bool],
        further: &[f64],
        end: EpisodeEnd,
    ) -> Result<Vec<f64>> {
        let mut rewards = Vec::with_capacity(grasping.len());
        // -Phi of the state in which a transition starts.
        let mut before = 0.0;
        for (t, held) in grasping.iter().enumerate() {
            let turned = rotation.map_or(0.0, |rotation| rotation[t]);
            let mut error = self.weight_position * position[t] + self.weight_rotation * turned;
            if let (true, Some(further)) = (*held, further.get(t)) {
                error += further;
            }
            let error = finite("weighted error", error)?;
            rewards.push(match self.form {
                // A difference, because -error would turn 0 into -0.
                Form::Penalty => 0.0 - error,
                Form::Literal => error,
                Form::Exp { scale } if *held => (-error / scale).exp(),
                Form::Exp { .. } => 0.0,
                Form::Potential { gamma } => {
                    let terminated = end == EpisodeEnd::Terminated && t + 1 == grasping.len();
                    let after = if terminated { 0.0 } else { error };
                    std::mem::replace(&mut before, after) - gamma * after
                }
            });
        }
        Ok(rewards)
    }
}

fn check_position(what: &'static str, position: &Vector3) -> Result<()> {
    if position.iter().all(|value| value.is_finite()) {
        return Ok(());
    }
    Err(Error::Value { what, found: format!("{position:?}"), expected: "finite numbers" })
}

fn same_length(what: &'static str, found: usize, steps: usize, trailing: &str) -> Result<()> {
    if found != steps {
        let expected = format!("({steps}, {trailing}): one for each flag of grasping");
        return Err(Error::Shape { what, found: vec![found], expected });
    }
    Ok(())
}

fn finite(what: &'static str, value: f64) -> Result<f64> {
    if value.is_finite() {
        return Ok(value);
    }
    Err(Error::Value { what, found: value.to_string(), expected: "a finite number; the inputs are too large" })
}
