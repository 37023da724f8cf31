//! Delta-pose control of many environments at once, each with its own plan: for simulators that step whole batches.

use crate::delta_pose::{DeltaPoseController, DeltaPoseLaw, Follow};
use crate::error::{Error, Result};
use crate::pose::{Matrix3, Pose, Vector3, check_rotation};

/// More environments than anyone steps at once. A wrong number must not exhaust the memory.
const MOST_ENVIRONMENTS: usize = 1 << 16;

/// The actions of many environments, each as by [`DeltaPoseLaw::action`].
///
/// # Errors
/// [`Error::Shape`] if the slices differ in length; otherwise as [`DeltaPoseLaw::action`].
pub fn actions(
    law: &DeltaPoseLaw,
    objects: &[Pose],
    targets: &[Pose],
    eefs: &[Pose],
    rotations_world_base: &[Matrix3],
) -> Result<Vec<[f64; 6]>> {
    let count = objects.len();
    one_each("target", targets.len(), count)?;
    one_each("eef", eefs.len(), count)?;
    one_each("rotation_world_base", rotations_world_base.len(), count)?;
    (0..count).map(|i| law.action(&objects[i], &targets[i], &eefs[i], &rotations_world_base[i])).collect()
}

/// Plans of many environments, all of the same length.
#[derive(Debug, Clone, Copy)]
pub struct PlanBatch<'a> {
    /// Steps of each plan.
    pub horizon: usize,
    /// (environments, horizon), metres.
    pub positions: &'a [Vector3],
    /// (environments, horizon), object -> world; `None` for plans of positions.
    pub rotations: Option<&'a [Matrix3]>,
}

/// One [`DeltaPoseController`] for each environment.
#[derive(Debug, Clone)]
pub struct DeltaPoseBatch {
    controllers: Vec<DeltaPoseController>,
}

impl DeltaPoseBatch {
    /// Controllers without plans.
    ///
    /// # Errors
    /// As [`DeltaPoseController::new`]; [`Error::Value`] for more than 65,536 environments.
    pub fn new(environments: usize, follow: Follow) -> Result<Self> {
        if environments > MOST_ENVIRONMENTS {
            let found = environments.to_string();
            return Err(Error::Value { what: "environments", found, expected: "at most 65536" });
        }
        Ok(Self { controllers: vec![DeltaPoseController::new(follow)?; environments] })
    }

    /// The controllers, in the environments' order.
    #[must_use]
    pub fn controllers(&self) -> &[DeltaPoseController] {
        &self.controllers
    }

    /// Gives new plans to the `chosen` environments, as [`DeltaPoseController::set_plan`]; the others keep theirs.
    ///
    /// # Errors
    /// [`Error::Shape`] if there is not one plan, object and choice for each environment; otherwise as
    /// [`DeltaPoseController::set_plan`]. After an error every environment keeps the plan it had.
    pub fn set_plans(&mut self, plans: PlanBatch<'_>, objects: &[Pose], chosen: &[bool]) -> Result<()> {
        let PlanBatch { horizon, positions, rotations } = plans;
        let count = self.controllers.len();
        one_each("object", objects.len(), count)?;
        one_each("chosen", chosen.len(), count)?;
        let steps = |found: usize| match count.checked_mul(horizon) == Some(found) {
            true => Ok(()),
            false => Err(Error::Shape {
                what: "plan",
                found: vec![found],
                expected: format!("({count}, {horizon}, ...): one plan for each environment"),
            }),
        };
        steps(positions.len())?;
        rotations.map_or(Ok(()), |rotations| steps(rotations.len()))?;
        let mut next = Vec::with_capacity(count);
        for (i, controller) in self.controllers.iter().enumerate().filter(|(i, _)| chosen[*i]) {
            let range = i * horizon..(i + 1) * horizon;
            let rotations = rotations.map(|rotations| rotations[range.clone()].to_vec());
            let mut controller = controller.clone();
            controller.set_plan(positions[range].to_vec(), rotations, &objects[i])?;
            next.push((i, controller));
        }
        for (i, controller) in next {
            self.controllers[i] = controller;
        }
        Ok(())
    }

    /// Advances every environment along its plan, as [`DeltaPoseController::target`].
    ///
    /// # Errors
    /// [`Error::Shape`] if there is not one object for each environment, [`Error::Value`] if an environment has no
    /// plan or a matrix is not a rotation. After an error no environment has advanced.
    pub fn targets(&mut self, objects: &[Pose]) -> Result<Vec<Pose>> {
        one_each("object", objects.len(), self.controllers.len())?;
        for (i, (controller, object)) in self.controllers.iter().zip(objects).enumerate() {
            check_rotation("object", &object.rotation)?;
            if !controller.has_plan() {
                let found = format!("environment {i} without a plan");
                return Err(Error::Value { what: "plan", found, expected: "a plan for each; call set_plans first" });
            }
        }
        self.controllers.iter_mut().zip(objects).map(|(controller, object)| controller.target(object)).collect()
    }
}

fn one_each(what: &'static str, found: usize, environments: usize) -> Result<()> {
    if found != environments {
        let expected = format!("({environments}, ...): one for each environment");
        return Err(Error::Shape { what, found: vec![found], expected });
    }
    Ok(())
}
