//! Bindings of `ocplanner_core::delta_pose_batch`.

use numpy::{IntoPyArray, PyArray1};
use ocplanner_core::delta_pose_batch::{self as core, PlanBatch};
use pyo3::prelude::*;

use crate::arguments::{count, name};
use crate::arrays::flags;
use crate::delta_pose::{
    PoseArrays, PoseOutput, follow_of, pose_output, poses, positions as position_rows, rotations as rotation_rows,
};
use crate::error::{shape_error, to_python};

/// Follows one plan in each of many environments.
#[pyclass(module = "ocplanner._core")]
pub struct DeltaPoseBatch(core::DeltaPoseBatch);

#[pymethods]
impl DeltaPoseBatch {
    #[new]
    #[pyo3(signature = (environments, follow="gated", *, gate_position=0.025, gate_rotation=0.2))]
    fn new(
        py: Python<'_>,
        #[pyo3(from_py_with = count)] environments: usize,
        #[pyo3(from_py_with = name)] follow: &str,
        gate_position: f64,
        gate_rotation: f64,
    ) -> PyResult<Self> {
        let follow = follow_of(py, follow, gate_position, gate_rotation)?;
        core::DeltaPoseBatch::new(environments, follow).map(Self).map_err(|error| to_python(py, &error))
    }

    #[pyo3(signature = (positions, rotations, pose_object, chosen=None))]
    fn set_plans<'py>(
        &mut self,
        py: Python<'py>,
        positions: Bound<'py, PyAny>,
        rotations: Option<Bound<'py, PyAny>>,
        pose_object: PoseArrays<'py>,
        chosen: Option<Bound<'py, PyAny>>,
    ) -> PyResult<()> {
        let positions = position_rows("plan", &positions)?;
        let rotations = rotations.map(|rotations| rotation_rows("plan", &rotations)).transpose()?;
        let [_, horizon] = positions.leading[..] else {
            let message = format!("plan: leading shape {:?}, expected environments and steps", positions.leading);
            return Err(shape_error(py, message));
        };
        if let Some(rotations) = &rotations {
            rotations.expect(py, "plan", &positions.leading)?;
        }
        let objects = self.objects(py, &pose_object)?;
        let chosen = match &chosen {
            Some(chosen) => flags("chosen", chosen)?,
            None => vec![true; self.0.controllers().len()],
        };
        let rotations = rotations.as_ref().map(|rotations| rotations.rows.as_slice());
        let plans = PlanBatch { horizon, positions: &positions.rows, rotations };
        py.detach(|| self.0.set_plans(plans, &objects, &chosen)).map_err(|error| to_python(py, &error))
    }

    fn targets<'py>(&mut self, py: Python<'py>, pose_object: PoseArrays<'py>) -> PyResult<PoseOutput<'py>> {
        let objects = self.objects(py, &pose_object)?;
        let targets = py.detach(|| self.0.targets(&objects)).map_err(|error| to_python(py, &error))?;
        pose_output(py, &targets, &[targets.len()])
    }

    #[getter]
    fn index<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u64>> {
        let indices = self.0.controllers().iter().map(|controller| controller.index() as u64);
        indices.collect::<Vec<_>>().into_pyarray(py)
    }

    #[getter]
    fn at_end<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        self.0.controllers().iter().map(|controller| controller.at_end()).collect::<Vec<_>>().into_pyarray(py)
    }
}

impl DeltaPoseBatch {
    /// One pose for each environment.
    fn objects(&self, py: Python<'_>, object: &PoseArrays<'_>) -> PyResult<Vec<ocplanner_core::pose::Pose>> {
        let objects = poses("object", object)?;
        objects.expect(py, "object", &[self.0.controllers().len()])?;
        Ok(objects.rows)
    }
}
