//! Bindings of `ocplanner_core::planner`.

use numpy::{PyArrayDyn, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use ocplanner_core::nn::kernels::{Level, Storage};
use ocplanner_core::planner::{self as core, Modes, Outputs, Plans};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::arguments::{count, items, name, optional_count};
use crate::arrays::{output, view_rows};
use crate::error::{shape_error, to_python, unknown_name};

/// The engine behind `ocplanner.Planner`.
#[pyclass(frozen, module = "ocplanner._core")]
pub struct PlannerEngine(core::Planner);

type Arrays<'py> = (Bound<'py, PyArrayDyn<f64>>, Option<Bound<'py, PyArrayDyn<f64>>>, Bound<'py, PyArrayDyn<f64>>);

#[pymethods]
impl PlannerEngine {
    /// Loads the bytes of a planner file, with the weights stored as "f32" or "bf16".
    #[new]
    #[pyo3(signature = (data, storage="f32"))]
    fn new(py: Python<'_>, data: &Bound<'_, PyBytes>, #[pyo3(from_py_with = name)] storage: &str) -> PyResult<Self> {
        let storage = match storage {
            "f32" => Storage::F32,
            "bf16" => Storage::Bf16,
            _ => return Err(unknown_name(py, "storage", storage, &["f32", "bf16"])),
        };
        let bytes = data.as_bytes();
        let loaded = py.detach(|| core::Planner::load(bytes, storage, Level::detect()));
        loaded.map(Self).map_err(|error| to_python(py, &error))
    }

    /// The configuration as JSON text.
    #[getter]
    fn config_json(&self) -> &str {
        self.0.config_json()
    }

    /// Plans of the most probable mode, or of all modes: positions, rotations or None, probabilities. With `steps` only
    /// that many steps are decoded.
    #[pyo3(signature = (images, *, all_modes=false, threads=1, steps=None))]
    fn plan<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = items)] images: Vec<Bound<'py, PyAny>>,
        all_modes: bool,
        #[pyo3(from_py_with = count)] threads: usize,
        #[pyo3(from_py_with = optional_count)] steps: Option<usize>,
    ) -> PyResult<Arrays<'py>> {
        let (views, batch) = self.views(py, &images)?;
        let slices = slices(&views)?;
        let modes = if all_modes { Modes::All } else { Modes::Best };
        let config = self.0.config();
        let steps = steps.unwrap_or(config.horizon);
        let plans = py.detach(|| self.0.plan(&slices, batch, modes, steps, threads));
        let Plans { position, rotation, probability } = plans.map_err(|error| to_python(py, &error))?;
        let leading = if all_modes { vec![batch, config.modes] } else { vec![batch] };
        let position = output(py, position, &leading, &[steps, 3])?;
        let rotation = match config.outputs {
            Outputs::Pose => Some(output(py, rotation, &leading, &[steps, 3, 3])?),
            Outputs::Position => None,
        };
        Ok((position, rotation, output(py, probability, &leading, &[])?))
    }

    /// Latent means of the most probable mode, (B, latent) float32.
    #[pyo3(signature = (images, threads=1))]
    fn encode<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = items)] images: Vec<Bound<'py, PyAny>>,
        #[pyo3(from_py_with = count)] threads: usize,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let (views, batch) = self.views(py, &images)?;
        let slices = slices(&views)?;
        let latents = py.detach(|| self.0.encode(&slices, batch, threads)).map_err(|error| to_python(py, &error))?;
        output(py, latents, &[batch, self.0.config().latent], &[])
    }
}

/// Checked images, one array per camera.
type Views<'py> = Vec<PyReadonlyArrayDyn<'py, u8>>;

impl PlannerEngine {
    /// Views of one array of images per camera, all of the same length, and that length.
    fn views<'py>(&self, py: Python<'py>, images: &[Bound<'py, PyAny>]) -> PyResult<(Views<'py>, usize)> {
        let config = self.0.config();
        if images.len() != config.cameras.len() {
            let message =
                format!("images: found {} arrays, expected one for each of {:?}", images.len(), config.cameras);
            return Err(shape_error(py, message));
        }
        let size = config.image_size;
        let mut views = Views::with_capacity(images.len());
        for (image, camera) in images.iter().zip(&config.cameras) {
            let name = format!("images[{camera:?}]");
            let shape = format!("(B, {size}, {size}, 3)");
            let array = view_rows::<u8>(&name, image, &shape, &[size, size, 3])?;
            let found = array.shape();
            if let Some(first) = views.first().filter(|first| first.shape()[0] != found[0]) {
                let other = &config.cameras[0];
                let message = format!("{name}: {} images, but {other} has {}", found[0], first.shape()[0]);
                return Err(shape_error(py, message));
            }
            views.push(array);
        }
        let batch = views.first().map_or(0, |first| first.shape()[0]);
        Ok((views, batch))
    }
}

/// The numbers of each view.
fn slices<'a>(views: &'a Views<'_>) -> PyResult<Vec<&'a [u8]>> {
    views.iter().map(|array| array.as_slice().map_err(PyErr::from)).collect()
}

/// Name of the instruction set that the engine uses: "avx512", "avx2" or "portable".
#[pyfunction]
pub fn simd_level() -> &'static str {
    Level::detect().name()
}
