//! Bindings of `ocplanner_core::reward`.

use numpy::{IntoPyArray, PyArray1, PyReadonlyArrayDyn};
use ocplanner_core::reward::{self as core, Episode, EpisodeEnd, Form, Poses, Rewards};
use pyo3::prelude::*;

use crate::arguments::{Pair, count, items, name};
use crate::arrays::{flags, view_rows};
use crate::error::{shape_error, to_python, unknown_name};
use crate::planner::{PlannerEngine, slices};

type PoseArrays<'py> = Pair<Bound<'py, PyAny>, Option<Bound<'py, PyAny>>>;
type Terms<'py> = (Bound<'py, PyArray1<f64>>, Option<Bound<'py, PyArray1<f64>>>, Bound<'py, PyArray1<f64>>);

/// Checked views of an episode's poses.
struct PoseViews<'py> {
    position: PyReadonlyArrayDyn<'py, f64>,
    rotation: Option<PyReadonlyArrayDyn<'py, f64>>,
}

impl<'py> PoseViews<'py> {
    fn new(what: &str, Pair(position, rotation): &PoseArrays<'py>) -> PyResult<Self> {
        let position = view_rows::<f64>(&format!("{what} position"), position, "(T, 3)", &[3])?;
        let name = format!("{what} rotation");
        let rotation = rotation.as_ref().map(|array| view_rows::<f64>(&name, array, "(T, 3, 3)", &[3, 3]));
        Ok(Self { position, rotation: rotation.transpose()? })
    }

    fn poses(&self) -> PyResult<Poses<'_>> {
        let rotation = match &self.rotation {
            Some(array) => Some(array.as_slice()?.as_chunks::<3>().0.as_chunks::<3>().0),
            None => None,
        };
        Ok(Poses { position: self.position.as_slice()?.as_chunks::<3>().0, rotation })
    }
}

/// Weights and form of the reward; the stub gives the units.
#[pyclass(frozen, module = "ocplanner._core")]
struct RewardLaw(core::RewardLaw);

#[pymethods]
impl RewardLaw {
    #[new]
    #[pyo3(signature = (form="penalty", *, weight_position=0.003, weight_rotation=0.003, scale=2.5e-4, gamma=0.99))]
    fn new(
        py: Python<'_>,
        #[pyo3(from_py_with = name)] form: &str,
        weight_position: f64,
        weight_rotation: f64,
        scale: f64,
        gamma: f64,
    ) -> PyResult<Self> {
        let form = match form {
            "penalty" => Form::Penalty,
            "literal" => Form::Literal,
            "exp" => Form::Exp { scale },
            "potential" => Form::Potential { gamma },
            _ => return Err(unknown_name(py, "reward form", form, &["penalty", "literal", "exp", "potential"])),
        };
        let law = core::RewardLaw { weight_position, weight_rotation, form };
        law.validate().map(Self).map_err(|error| to_python(py, &error))
    }

    /// Terms and rewards of an episode.
    #[pyo3(signature = (planned, achieved, grasping, *, terminal=true))]
    fn rewards<'py>(
        &self,
        py: Python<'py>,
        planned: PoseArrays<'py>,
        achieved: PoseArrays<'py>,
        grasping: &Bound<'py, PyAny>,
        terminal: bool,
    ) -> PyResult<Terms<'py>> {
        let (planned, achieved) = (PoseViews::new("planned", &planned)?, PoseViews::new("achieved", &achieved)?);
        let grasping = flags("grasping", grasping)?;
        let (planned, achieved) = (planned.poses()?, achieved.poses()?);
        let mut rewards = Rewards::default();
        py.detach(|| self.0.rewards(planned, achieved, &grasping, end(terminal), &mut rewards))
            .map_err(|error| to_python(py, &error))?;
        Ok(terms(py, rewards, planned.rotation.is_some()))
    }

    /// Terms and rewards of an episode that a planner sees.
    #[pyo3(signature = (planner, images, achieved, grasping, *, step=0, terminal=true, threads=1))]
    #[expect(clippy::too_many_arguments, reason = "the last three are keyword-only, each with a default")]
    fn label<'py>(
        &self,
        py: Python<'py>,
        planner: &PlannerEngine,
        #[pyo3(from_py_with = items)] images: Vec<Bound<'py, PyAny>>,
        achieved: PoseArrays<'py>,
        grasping: &Bound<'py, PyAny>,
        #[pyo3(from_py_with = count)] step: usize,
        terminal: bool,
        #[pyo3(from_py_with = count)] threads: usize,
    ) -> PyResult<Terms<'py>> {
        let (views, batch) = planner.views(py, &images)?;
        let images = slices(&views)?;
        let achieved = PoseViews::new("achieved", &achieved)?;
        let grasping = flags("grasping", grasping)?;
        let achieved = achieved.poses()?;
        if grasping.len() != batch {
            let message = format!("grasping: {} flags, but there are {batch} images", grasping.len());
            return Err(shape_error(py, message));
        }
        let episode = Episode { images: &images, achieved, grasping: &grasping, end: end(terminal) };
        let mut rewards = Rewards::default();
        py.detach(|| self.0.label(&planner.0, &episode, step, threads, &mut rewards))
            .map_err(|error| to_python(py, &error))?;
        Ok(terms(py, rewards, planner.plans_rotations()))
    }
}

fn end(terminal: bool) -> EpisodeEnd {
    if terminal { EpisodeEnd::Terminated } else { EpisodeEnd::Truncated }
}

fn terms(py: Python<'_>, rewards: Rewards, with_rotation: bool) -> Terms<'_> {
    let rotation = with_rotation.then(|| rewards.rotation.into_pyarray(py));
    (rewards.position.into_pyarray(py), rotation, rewards.reward.into_pyarray(py))
}

/// Adds this file's class to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<RewardLaw>()
}
