//! Bindings of `ocplanner_core::reward`.

use numpy::{IntoPyArray, PyArray1, PyReadonlyArrayDyn};
use ocplanner_core::reward::{self as core, EpisodeEnd, Form, Poses, Rewards};
use pyo3::prelude::*;

use crate::arguments::{Pair, name};
use crate::arrays::{flags, view_rows};
use crate::error::{to_python, unknown_name};

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
pub struct RewardLaw(core::RewardLaw);

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
    #[pyo3(signature = (planned, achieved, grasping, *, further=None, terminal=true))]
    fn rewards<'py>(
        &self,
        py: Python<'py>,
        planned: PoseArrays<'py>,
        achieved: PoseArrays<'py>,
        grasping: &Bound<'py, PyAny>,
        further: Option<Bound<'py, PyAny>>,
        terminal: bool,
    ) -> PyResult<Terms<'py>> {
        let (planned, achieved) = (PoseViews::new("planned", &planned)?, PoseViews::new("achieved", &achieved)?);
        let grasping = flags("grasping", grasping)?;
        let further = further.map(|array| view_rows::<f64>("further error", &array, "(T,)", &[])).transpose()?;
        let further = further.as_ref().map_or(Ok(&[][..]), |array| array.as_slice())?;
        let (planned, achieved) = (planned.poses()?, achieved.poses()?);
        let end = if terminal { EpisodeEnd::Terminated } else { EpisodeEnd::Truncated };
        let found = py.detach(|| self.0.rewards(planned, achieved, &grasping, further, end));
        let Rewards { position, rotation, reward } = found.map_err(|error| to_python(py, &error))?;
        let rotation = rotation.map(|term| term.into_pyarray(py));
        Ok((position.into_pyarray(py), rotation, reward.into_pyarray(py)))
    }
}
