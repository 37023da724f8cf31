//! Bindings of `ocplanner_core::planner`.

use numpy::ndarray::{ArrayD, IxDyn};
use numpy::{IntoPyArray, PyArrayDyn, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use ocplanner_core::nn::kernels::{Level, Storage};
use ocplanner_core::planner::{self as core, Modes, Outputs, Plans};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::arrays::view;
use crate::errors::{shape_error, to_python};

/// The engine behind `ocplanner.Planner`.
#[pyclass(frozen, module = "ocplanner._core")]
struct PlannerEngine(core::Planner);

type Arrays<'py> = (Bound<'py, PyArrayDyn<f64>>, Option<Bound<'py, PyArrayDyn<f64>>>, Bound<'py, PyArrayDyn<f64>>);

#[pymethods]
impl PlannerEngine {
    /// Loads the bytes of a planner file, with `storage` "f32" or "bf16" for the weights.
    #[new]
    #[pyo3(signature = (data, storage="f32"))]
    fn new(py: Python<'_>, data: &Bound<'_, PyBytes>, storage: &str) -> PyResult<Self> {
        let storage = match storage {
            "f32" => Storage::F32,
            "bf16" => Storage::Bf16,
            _ => return Err(unknown(py, "storage", storage, &["f32", "bf16"])),
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

    /// Plans of the most probable mode, or of all modes with `all_modes`: positions, rotations or None, probabilities.
    #[pyo3(signature = (images, all_modes=false, threads=1))]
    fn plan<'py>(
        &self,
        py: Python<'py>,
        images: Vec<Bound<'py, PyAny>>,
        all_modes: bool,
        threads: usize,
    ) -> PyResult<Arrays<'py>> {
        let (views, batch) = self.views(py, &images)?;
        let slices = slices(&views)?;
        let modes = if all_modes { Modes::All } else { Modes::Best };
        let mut plans = Plans::default();
        py.detach(|| self.0.plan(&slices, batch, modes, threads, &mut plans)).map_err(|error| to_python(py, &error))?;
        let config = self.0.config();
        let leading = if all_modes { vec![batch, config.modes] } else { vec![batch] };
        let shaped = |values: Vec<f64>, trailing: &[usize]| {
            let shape = [leading.as_slice(), trailing].concat();
            let array = ArrayD::from_shape_vec(IxDyn(&shape), values);
            array.map(|array| array.into_pyarray(py)).map_err(|error| shape_error(py, error.to_string()))
        };
        let position = shaped(plans.position, &[config.horizon, 3])?;
        let rotation = match config.outputs {
            Outputs::Pose => Some(shaped(plans.rotation, &[config.horizon, 3, 3])?),
            Outputs::Position => None,
        };
        Ok((position, rotation, shaped(plans.probability, &[])?))
    }

    /// Latent means of the most probable mode, (B, latent) float32.
    #[pyo3(signature = (images, threads=1))]
    fn encode<'py>(
        &self,
        py: Python<'py>,
        images: Vec<Bound<'py, PyAny>>,
        threads: usize,
    ) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
        let (views, batch) = self.views(py, &images)?;
        let slices = slices(&views)?;
        let mut latents = Vec::new();
        py.detach(|| self.0.encode(&slices, batch, threads, &mut latents)).map_err(|error| to_python(py, &error))?;
        let array = ArrayD::from_shape_vec(IxDyn(&[batch, self.0.config().latent]), latents);
        array.map(|array| array.into_pyarray(py)).map_err(|error| shape_error(py, error.to_string()))
    }
}

type Views<'py> = Vec<PyReadonlyArrayDyn<'py, u8>>;

impl PlannerEngine {
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
            let array = view::<u8>(&name, image, &shape, &[size, size, 3])?;
            let found = array.shape();
            if found.len() != 4 {
                return Err(shape_error(py, format!("{name}: expected shape {shape}, found {found:?}")));
            }
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

fn slices<'a>(views: &'a Views<'_>) -> PyResult<Vec<&'a [u8]>> {
    views.iter().map(|array| array.as_slice().map_err(PyErr::from)).collect()
}

fn unknown(py: Python<'_>, kind: &str, name: &str, known: &[&str]) -> PyErr {
    let class = py.import("ocplanner.errors").and_then(|module| module.getattr("UnknownNameError"));
    match class.and_then(|class| class.call1((kind, name, known.to_vec()))) {
        Ok(exception) => PyErr::from_value(exception),
        Err(import_error) => import_error,
    }
}

/// Name of the instruction set that the engine uses: "avx512", "avx2" or "portable".
#[pyfunction]
fn simd_level() -> &'static str {
    Level::detect().name()
}

/// Adds this file's functions and classes to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PlannerEngine>()?;
    module.add_function(wrap_pyfunction!(simd_level, module)?)
}
