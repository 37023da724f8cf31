//! Bindings of `ocplanner_core::delta_pose`.

use std::borrow::Cow;

use numpy::{PyArrayDyn, PyUntypedArrayMethods};
use ocplanner_core::delta_pose as core;
use ocplanner_core::delta_pose_batch::actions;
use ocplanner_core::error::Error;
use ocplanner_core::pose::{Matrix3, Pose, Vector3, check_rotation};
use pyo3::prelude::*;

use crate::arguments::{Pair, name};
use crate::arrays::{output, strided_view};
use crate::error::{shape_error, to_python};

/// A pose as Python passes it: positions and rotations.
pub type PoseArrays<'py> = Pair<Bound<'py, PyAny>, Bound<'py, PyAny>>;
/// A pose as Python receives it.
pub type PoseOutput<'py> = (Bound<'py, PyArrayDyn<f64>>, Bound<'py, PyArrayDyn<f64>>);

/// The most numbers copied from an array that is not in C order: a broadcast array may be far larger than the memory.
const MOST_STRIDED: usize = 1 << 24;

/// Rows of numbers and the axes before them.
pub struct Rows<T> {
    /// Lengths of the axes before a row.
    pub leading: Vec<usize>,
    /// The rows, in C order.
    pub rows: Vec<T>,
}

impl<T> Rows<T> {
    /// Raises `ShapeError` unless the axes before a row are these.
    pub fn expect(&self, py: Python<'_>, what: &str, leading: &[usize]) -> PyResult<()> {
        if self.leading == leading {
            return Ok(());
        }
        Err(shape_error(py, format!("{what}: leading shape {:?}, expected {leading:?}", self.leading)))
    }
}

/// The rows of a (..., 3) array.
pub fn positions(what: &str, value: &Bound<'_, PyAny>) -> PyResult<Rows<Vector3>> {
    rows(what, value, "(..., 3)", &[3], |numbers| numbers.as_chunks::<3>().0.to_vec())
}

/// The matrices of a (..., 3, 3) array.
fn matrices(what: &str, value: &Bound<'_, PyAny>) -> PyResult<Rows<Matrix3>> {
    let read = |numbers: &[f64]| numbers.as_chunks::<3>().0.as_chunks::<3>().0.to_vec();
    rows(what, value, "(..., 3, 3)", &[3, 3], read)
}

/// The matrices of a (..., 3, 3) array, checked to be rotations.
pub fn rotations(what: &'static str, value: &Bound<'_, PyAny>) -> PyResult<Rows<Matrix3>> {
    let rows = matrices(what, value)?;
    let checked = rows.rows.iter().try_for_each(|rotation| check_rotation(what, rotation));
    checked.map_err(|error| to_python(value.py(), &error))?;
    Ok(rows)
}

/// The poses of a pair of (..., 3) and (..., 3, 3) arrays, checked to be finite numbers and rotations.
pub fn poses(what: &'static str, Pair(position, rotation): &PoseArrays<'_>) -> PyResult<Rows<Pose>> {
    let py = position.py();
    let Rows { leading, rows } = positions(what, position)?;
    let rotations = matrices(what, rotation)?;
    rotations.expect(py, what, &leading)?;
    let pairs = rows.into_iter().zip(rotations.rows);
    let rows = pairs.map(|(position, rotation)| Pose::checked(what, position, rotation));
    let rows = rows.collect::<Result<Vec<_>, Error>>().map_err(|error| to_python(py, &error))?;
    Ok(Rows { leading, rows })
}

fn rows<T>(
    what: &str,
    value: &Bound<'_, PyAny>,
    shape: &str,
    trailing: &[usize],
    read: impl Fn(&[f64]) -> Vec<T>,
) -> PyResult<Rows<T>> {
    let array = strided_view::<f64>(what, value, shape, trailing)?;
    if !array.is_c_contiguous() && array.len() > MOST_STRIDED {
        let message =
            format!("{what}: a broadcast or strided array of {:?}; use numpy.ascontiguousarray", array.shape());
        return Err(shape_error(value.py(), message));
    }
    // Only where C order is certain: as_slice also accepts Fortran order and returns it as it lies in memory.
    let numbers = if array.is_c_contiguous() {
        Cow::Borrowed(array.as_slice()?)
    } else {
        Cow::Owned(array.as_array().iter().copied().collect())
    };
    let leading = array.shape()[..array.ndim() - trailing.len()].to_vec();
    Ok(Rows { leading, rows: read(&numbers) })
}

/// How a pose difference becomes an action; the stub gives the units.
#[pyclass(frozen, module = "ocplanner._core")]
pub struct DeltaPoseLaw(core::DeltaPoseLaw);

#[pymethods]
impl DeltaPoseLaw {
    #[new]
    #[pyo3(signature = (*, gain_position=1.0, gain_rotation=1.0, limit_horizontal=0.05, limit_vertical=0.05,
                        limit_rotation=0.2, scale_position=0.05, scale_rotation=0.5))]
    #[expect(clippy::too_many_arguments, reason = "keyword-only, each with a default")]
    fn new(
        py: Python<'_>,
        gain_position: f64,
        gain_rotation: f64,
        limit_horizontal: f64,
        limit_vertical: f64,
        limit_rotation: f64,
        scale_position: f64,
        scale_rotation: f64,
    ) -> PyResult<Self> {
        let law = core::DeltaPoseLaw {
            gain_position,
            gain_rotation,
            limit_horizontal,
            limit_vertical,
            limit_rotation,
            scale_position,
            scale_rotation,
        };
        law.validate().map(Self).map_err(|error| to_python(py, &error))
    }
}

/// The way of following by its name.
pub fn follow_of(py: Python<'_>, name: &str, gate_position: f64, gate_rotation: f64) -> PyResult<core::Follow> {
    match name {
        "open-loop" => Ok(core::Follow::OpenLoop),
        "time" => Ok(core::Follow::Time),
        "gated" => Ok(core::Follow::Gated { position: gate_position, rotation: gate_rotation }),
        other => {
            let found = format!("{other:?}");
            let error = Error::Value { what: "follow", found, expected: "one of 'open-loop', 'time', 'gated'" };
            Err(to_python(py, &error))
        }
    }
}

/// Actions for one environment or for many: all arguments have the same axes before a pose's own.
#[pyfunction]
#[pyo3(signature = (pose_object, pose_target, pose_eef, rotation_world_base, law=None))]
pub fn delta_pose_action<'py>(
    pose_object: PoseArrays<'py>,
    pose_target: PoseArrays<'py>,
    pose_eef: PoseArrays<'py>,
    rotation_world_base: Bound<'py, PyAny>,
    law: Option<&DeltaPoseLaw>,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let py = rotation_world_base.py();
    let (object, target) = (poses("object", &pose_object)?, poses("target", &pose_target)?);
    let (eef, base) = (poses("eef", &pose_eef)?, rotations("rotation_world_base", &rotation_world_base)?);
    target.expect(py, "target", &object.leading)?;
    eef.expect(py, "eef", &object.leading)?;
    base.expect(py, "rotation_world_base", &object.leading)?;
    let law = law.map_or_else(core::DeltaPoseLaw::default, |law| law.0);
    let actions = py.detach(|| actions(&law, &object.rows, &target.rows, &eef.rows, &base.rows));
    let actions = actions.map_err(|error| to_python(py, &error))?;
    output(py, actions.into_flattened(), &object.leading, &[6])
}

/// Follows one plan at a time.
#[pyclass(module = "ocplanner._core")]
pub struct DeltaPoseController(core::DeltaPoseController);

#[pymethods]
impl DeltaPoseController {
    #[new]
    #[pyo3(signature = (follow="gated", *, gate_position=0.025, gate_rotation=0.2))]
    fn new(
        py: Python<'_>,
        #[pyo3(from_py_with = name)] follow: &str,
        gate_position: f64,
        gate_rotation: f64,
    ) -> PyResult<Self> {
        let follow = follow_of(py, follow, gate_position, gate_rotation)?;
        core::DeltaPoseController::new(follow).map(Self).map_err(|error| to_python(py, &error))
    }

    #[pyo3(signature = (positions, rotations, pose_object))]
    fn set_plan<'py>(
        &mut self,
        py: Python<'py>,
        positions: Bound<'py, PyAny>,
        rotations: Option<Bound<'py, PyAny>>,
        pose_object: PoseArrays<'py>,
    ) -> PyResult<()> {
        let positions = self::positions("plan", &positions)?;
        let rotations = rotations.map(|rotations| self::rotations("plan", &rotations)).transpose()?;
        positions.expect(py, "plan", &[positions.rows.len()])?;
        if let Some(rotations) = &rotations {
            rotations.expect(py, "plan", &positions.leading)?;
        }
        let object = one(py, &pose_object)?;
        self.0
            .set_plan(positions.rows, rotations.map(|rotations| rotations.rows), &object)
            .map_err(|error| to_python(py, &error))
    }

    fn target<'py>(&mut self, py: Python<'py>, pose_object: PoseArrays<'py>) -> PyResult<PoseOutput<'py>> {
        let target = self.0.target(&one(py, &pose_object)?).map_err(|error| to_python(py, &error))?;
        pose_output(py, &[target], &[])
    }

    #[getter]
    fn index(&self) -> usize {
        self.0.index()
    }

    #[getter]
    fn at_end(&self) -> bool {
        self.0.at_end()
    }
}

/// Arrays of poses with the axes `leading`.
pub fn pose_output<'py>(py: Python<'py>, poses: &[Pose], leading: &[usize]) -> PyResult<PoseOutput<'py>> {
    let positions = poses.iter().flat_map(|pose| pose.position).collect();
    let rotations = poses.iter().flat_map(|pose| pose.rotation).flatten().collect();
    Ok((output(py, positions, leading, &[3])?, output(py, rotations, leading, &[3, 3])?))
}

/// A single pose.
fn one(py: Python<'_>, object: &PoseArrays<'_>) -> PyResult<Pose> {
    let object = poses("object", object)?;
    object.expect(py, "object", &[])?;
    Ok(object.rows[0])
}
