//! Bindings of `ocplanner_core::delta_pose`.

use numpy::ndarray::{ArrayView1, ArrayView2, ArrayView3, Axis, Ix1, Ix2, Ix3};
use numpy::{Element, IntoPyArray, PyArray1, PyArray2};
use ocplanner_core::delta_pose as core;
use ocplanner_core::error::{Error, Result};
use ocplanner_core::pose::{Pose, check_rotation};
use pyo3::prelude::*;

use crate::arguments::{Pair, name};
use crate::arrays::Numbers;
use crate::errors::to_python;

type PoseArrays<'py> = Pair<Numbers<'py, Ix1>, Numbers<'py, Ix2>>;
type PoseBatch<'py> = Pair<Numbers<'py, Ix2>, Numbers<'py, Ix3>>;

fn vector(what: &'static str, view: ArrayView1<'_, f64>) -> Result<[f64; 3]> {
    match view.len() {
        3 => Ok([view[0], view[1], view[2]]),
        n => Err(Error::Shape { what, found: vec![n], expected: "(3,)".into() }),
    }
}

fn matrix(what: &'static str, view: ArrayView2<'_, f64>) -> Result<[[f64; 3]; 3]> {
    if view.dim() != (3, 3) {
        return Err(Error::Shape { what, found: view.shape().to_vec(), expected: "(3, 3)".into() });
    }
    Ok(std::array::from_fn(|i| std::array::from_fn(|j| view[[i, j]])))
}

fn pose(what: &'static str, Pair(position, rotation): &PoseArrays<'_>) -> Result<Pose> {
    core::checked_pose(what, vector(what, position.0.as_array())?, matrix(what, rotation.0.as_array())?)
}

fn base(rotation: &Numbers<'_, Ix2>) -> Result<[[f64; 3]; 3]> {
    let rotation = matrix("rotation_world_base", rotation.0.as_array())?;
    check_rotation("rotation_world_base", &rotation)?;
    Ok(rotation)
}

fn poses(what: &'static str, Pair(positions, rotations): &PoseBatch<'_>) -> Result<Vec<Pose>> {
    let (positions, rotations) = (positions.0.as_array(), rotations.0.as_array());
    same_length(what, positions.len_of(Axis(0)), rotations)?;
    positions
        .outer_iter()
        .zip(rotations.outer_iter())
        .map(|(p, r)| core::checked_pose(what, vector(what, p)?, matrix(what, r)?))
        .collect()
}

fn same_length<T: Element>(what: &'static str, count: usize, rotations: ArrayView3<'_, T>) -> Result<()> {
    if rotations.len_of(Axis(0)) != count {
        return Err(Error::Shape { what, found: rotations.shape().to_vec(), expected: format!("({count}, 3, 3)") });
    }
    Ok(())
}

fn to_arrays<'py>(py: Python<'py>, pose: Pose) -> (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>) {
    let rotation = numpy::ndarray::arr2(&pose.rotation);
    (pose.position.to_vec().into_pyarray(py), rotation.into_pyarray(py))
}

/// Gains, limits and scales of the law; see the stub for units.
#[pyclass(frozen, module = "ocplanner._core")]
struct DeltaPoseLaw(core::DeltaPoseLaw);

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

fn law_of(law: Option<&DeltaPoseLaw>) -> core::DeltaPoseLaw {
    law.map_or_else(core::DeltaPoseLaw::default, |law| law.0)
}

/// One action from one set of poses.
#[pyfunction]
#[pyo3(signature = (pose_object, pose_target, pose_eef, rotation_world_base, law=None))]
fn delta_pose_action<'py>(
    py: Python<'py>,
    pose_object: PoseArrays<'py>,
    pose_target: PoseArrays<'py>,
    pose_eef: PoseArrays<'py>,
    rotation_world_base: Numbers<'py, Ix2>,
    law: Option<&DeltaPoseLaw>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let compute = || -> Result<[f64; 6]> {
        let (object, target, eef) =
            (pose("object", &pose_object)?, pose("target", &pose_target)?, pose("eef", &pose_eef)?);
        law_of(law).action(&object, &target, &eef, &base(&rotation_world_base)?)
    };
    compute().map(|action| action.to_vec().into_pyarray(py)).map_err(|error| to_python(py, &error))
}

/// B actions from B sets of poses.
#[pyfunction]
#[pyo3(signature = (pose_object, pose_target, pose_eef, rotation_world_base, law=None))]
fn delta_pose_actions<'py>(
    py: Python<'py>,
    pose_object: PoseBatch<'py>,
    pose_target: PoseBatch<'py>,
    pose_eef: PoseBatch<'py>,
    rotation_world_base: Numbers<'py, Ix3>,
    law: Option<&DeltaPoseLaw>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let compute = || -> Result<numpy::ndarray::Array2<f64>> {
        let (object, target, eef) =
            (poses("object", &pose_object)?, poses("target", &pose_target)?, poses("eef", &pose_eef)?);
        let count = object.len();
        for (what, found) in [("target", target.len()), ("eef", eef.len())] {
            if found != count {
                return Err(Error::Shape { what, found: vec![found], expected: format!("({count}, ...)") });
            }
        }
        same_length("rotation_world_base", count, rotation_world_base.0.as_array())?;
        let bases = rotation_world_base
            .0
            .as_array()
            .outer_iter()
            .map(|r| {
                let rotation = matrix("rotation_world_base", r)?;
                check_rotation("rotation_world_base", &rotation)?;
                Ok(rotation)
            })
            .collect::<Result<Vec<_>>>()?;
        let law = law_of(law);
        let actions = py.detach(|| {
            (0..count)
                .map(|i| law.action(&object[i], &target[i], &eef[i], &bases[i]))
                .collect::<Result<Vec<[f64; 6]>>>()
        })?;
        Ok(numpy::ndarray::Array2::from(actions))
    };
    compute().map(|actions| actions.into_pyarray(py)).map_err(|error| to_python(py, &error))
}

/// Follows one plan at a time.
#[pyclass(module = "ocplanner._core")]
struct DeltaPoseController(core::DeltaPoseController);

#[pymethods]
impl DeltaPoseController {
    #[new]
    #[pyo3(signature = (follow="gated", *, gate_position=0.025, gate_rotation=0.2, law=None))]
    fn new(
        py: Python<'_>,
        #[pyo3(from_py_with = name)] follow: &str,
        gate_position: f64,
        gate_rotation: f64,
        law: Option<&DeltaPoseLaw>,
    ) -> PyResult<Self> {
        let follow = match follow {
            "open-loop" => core::Follow::OpenLoop,
            "time" => core::Follow::Time,
            "gated" => core::Follow::Gated { position: gate_position, rotation: gate_rotation },
            other => {
                let found = format!("{other:?}");
                let error = Error::Value { what: "follow", found, expected: "one of 'open-loop', 'time', 'gated'" };
                return Err(to_python(py, &error));
            }
        };
        core::DeltaPoseController::new(law_of(law), follow).map(Self).map_err(|error| to_python(py, &error))
    }

    #[pyo3(signature = (positions, rotations, pose_object))]
    fn set_plan<'py>(
        &mut self,
        py: Python<'py>,
        positions: Numbers<'py, Ix2>,
        rotations: Option<Numbers<'py, Ix3>>,
        pose_object: PoseArrays<'py>,
    ) -> PyResult<()> {
        let convert = || -> Result<_> {
            let positions =
                positions.0.as_array().outer_iter().map(|p| vector("plan", p)).collect::<Result<Vec<_>>>()?;
            let rotations = match &rotations {
                None => None,
                Some(r) => Some(r.0.as_array().outer_iter().map(|m| matrix("plan", m)).collect::<Result<Vec<_>>>()?),
            };
            Ok((positions, rotations, pose("object", &pose_object)?))
        };
        convert()
            .and_then(|(positions, rotations, object)| self.0.set_plan(positions, rotations, &object))
            .map_err(|error| to_python(py, &error))
    }

    #[expect(clippy::type_complexity, reason = "a pose is a pair of arrays")]
    fn target<'py>(
        &mut self,
        py: Python<'py>,
        pose_object: PoseArrays<'py>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>)> {
        pose("object", &pose_object)
            .and_then(|object| self.0.target(&object))
            .map(|target| to_arrays(py, target))
            .map_err(|error| to_python(py, &error))
    }

    fn action<'py>(
        &self,
        py: Python<'py>,
        pose_object: PoseArrays<'py>,
        pose_target: PoseArrays<'py>,
        pose_eef: PoseArrays<'py>,
        rotation_world_base: Numbers<'py, Ix2>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let compute = || -> Result<[f64; 6]> {
            let (object, target, eef) =
                (pose("object", &pose_object)?, pose("target", &pose_target)?, pose("eef", &pose_eef)?);
            self.0.action(&object, &target, &eef, &base(&rotation_world_base)?)
        };
        compute().map(|action| action.to_vec().into_pyarray(py)).map_err(|error| to_python(py, &error))
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

/// Adds this file's functions and classes to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<DeltaPoseLaw>()?;
    module.add_class::<DeltaPoseController>()?;
    module.add_function(wrap_pyfunction!(delta_pose_action, module)?)?;
    module.add_function(wrap_pyfunction!(delta_pose_actions, module)?)
}
