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
use crate::planner::{Modes, Outputs, Planner, Plans};
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
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Rewards {
    /// (T,) |p' - p|^2, square metres, unweighted.
    pub position: Vec<f64>,
    /// (T,) |r' - r|^2, unweighted; empty if the plan has no rotations.
    pub rotation: Vec<f64>,
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
    /// transition. Without planned rotations the achieved ones are ignored and there is no rotation term. Only the
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
        end: EpisodeEnd,
        rewards: &mut Rewards,
    ) -> Result<()> {
        let steps = grasping.len();
        same_length("planned position", planned.position.len(), steps, "3")?;
        same_length("achieved position", achieved.position.len(), steps, "3")?;
        rewards.start(steps, planned.rotation.is_some());
        for (t, held) in grasping.iter().enumerate() {
            let error = position_error(&planned.position[t], &achieved.position[t])?;
            rewards.position[t] = if *held { error } else { 0.0 };
        }
        if let Some(planned) = planned.rotation {
            same_length("planned rotation", planned.len(), steps, "3, 3")?;
            let achieved = achieved.rotation.unwrap_or_default();
            same_length("achieved rotation", achieved.len(), steps, "3, 3")?;
            for (t, held) in grasping.iter().enumerate() {
                let error = rotation_error(&planned[t], &achieved[t])?;
                rewards.rotation[t] = if *held { error } else { 0.0 };
            }
        }
        self.combine(grasping, end, rewards)
    }
}

/// An episode as recorded, to be labelled by a planner.
#[derive(Debug, Clone, Copy)]
pub struct Episode<'a> {
    /// One slice per camera of the planner, (T, size, size, 3) uint8: what it sees before each transition.
    pub images: &'a [&'a [u8]],
    /// Where the object is when the planned step compared with it is due: after each transition, for the first step.
    pub achieved: Poses<'a>,
    /// Whether the robot holds the object during each transition.
    pub grasping: &'a [bool],
    /// How the episode ends.
    pub end: EpisodeEnd,
}

impl RewardLaw {
    /// Plans where the object is held, and nowhere else, and compares step `step` (0 is the next) of each plan.
    ///
    /// # Errors
    /// As [`Planner::plan`] and [`RewardLaw::rewards`]. [`Error::Value`] too for the potential form with a later
    /// step than the first: its error is known only after the state that it would be the potential of.
    pub fn label(
        &self,
        planner: &Planner,
        episode: &Episode<'_>,
        step: usize,
        threads: usize,
        rewards: &mut Rewards,
    ) -> Result<()> {
        let Episode { images, achieved, grasping, end } = *episode;
        let (steps, horizon) = (grasping.len(), planner.config().horizon);
        if step >= horizon {
            let found = format!("{step} of {horizon} steps");
            return Err(Error::Value { what: "step", found, expected: "below the planner's horizon" });
        }
        if step > 0 && matches!(self.form, Form::Potential { .. }) {
            return Err(Error::Value {
                what: "step",
                found: step.to_string(),
                expected: "0, as the potential form needs",
            });
        }
        planner.check_images(images, steps)?;
        same_length("achieved position", achieved.position.len(), steps, "3")?;
        let with_rotation = planner.config().outputs == Outputs::Pose;
        let achieved_rotation = achieved.rotation.unwrap_or_default();
        if with_rotation {
            same_length("achieved rotation", achieved_rotation.len(), steps, "3, 3")?;
        }
        rewards.start(steps, with_rotation);
        let (size, mut plans, mut start) = (planner.image_len(), Plans::default(), 0);
        for run in grasping.chunk_by(|a, b| a == b) {
            let range = start..start + run.len();
            start = range.end;
            if !run[0] {
                achieved.position[range.clone()].iter().try_for_each(|p| check_position("achieved position", p))?;
                let mut unused = achieved_rotation.iter().take(range.end).skip(range.start);
                unused.try_for_each(|rotation| check_rotation("achieved rotation", rotation))?;
                continue;
            }
            let seen: Vec<&[u8]> = images.iter().map(|all| &all[range.start * size..range.end * size]).collect();
            planner.plan(&seen, run.len(), Modes::Best, step + 1, threads, &mut plans)?;
            let planned = plans.position.as_chunks::<3>().0.iter().skip(step).step_by(step + 1);
            for (t, planned) in range.clone().zip(planned) {
                rewards.position[t] = position_error(planned, &achieved.position[t])?;
            }
            let planned = plans.rotation.as_chunks::<3>().0.as_chunks::<3>().0.iter().skip(step).step_by(step + 1);
            for (t, planned) in range.zip(planned) {
                rewards.rotation[t] = rotation_error(planned, &achieved_rotation[t])?;
            }
        }
        self.combine(grasping, end, rewards)
    }

    /// Rewards from terms that are zero where nothing is held.
    fn combine(&self, grasping: &[bool], end: EpisodeEnd, rewards: &mut Rewards) -> Result<()> {
        // -Phi of the state in which a transition starts.
        let mut before = 0.0;
        for (t, held) in grasping.iter().enumerate() {
            let turned = rewards.rotation.get(t).copied().unwrap_or(0.0);
            let error = self.weight_position * rewards.position[t] + self.weight_rotation * turned;
            let error = finite("weighted error", error)?;
            rewards.reward[t] = match self.form {
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
            };
        }
        Ok(())
    }
}

impl Rewards {
    /// Makes room for `steps` transitions, all terms zero.
    fn start(&mut self, steps: usize, with_rotation: bool) {
        let rotations = if with_rotation { steps } else { 0 };
        for (values, length) in
            [(&mut self.position, steps), (&mut self.rotation, rotations), (&mut self.reward, steps)]
        {
            values.clear();
            values.resize(length, 0.0);
        }
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
