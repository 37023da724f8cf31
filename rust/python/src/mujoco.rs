//! A MuJoCo model and its data, driven from Rust: the package's only unsafe code.
//!
//! MuJoCo is called through the library that the imported `mujoco` module has already loaded, never through a second
//! copy, and only if both report the same version. `mjModel` and `mjData` stay opaque: their addresses come from the
//! Python objects, and their arrays are read through the NumPy views that those objects provide, so no struct layout is
//! assumed. This is sound because:
//!
//! * The loop keeps the Python objects and the views alive, and MuJoCo never moves the buffers behind the views.
//! * `MjModel` and `MjData` are checked to be those very classes and to belong together; every view is checked to have the
//!   dtype, order and length that follow from the model's sizes, and every index to lie inside its array.
//! * An element is read or written through a raw pointer after a bounds check. No Rust reference to MuJoCo's memory
//!   outlives one element, so MuJoCo may write between two reads.
//! * While a loop runs, it is borrowed mutably, and so are the loops of other arms that run with it. As with
//!   `mujoco.mj_step`, which also releases the GIL, the caller must not step the same data from another thread meanwhile.
//!
//! A fatal MuJoCo error (an exhausted arena) ends the process with MuJoCo's own message, where `mujoco.mj_step` would
//! raise an exception.
#![expect(unsafe_code, reason = "calls MuJoCo's C functions and reads its arrays, as justified above")]

use std::ffi::{c_int, c_void};
use std::path::PathBuf;

use libloading::os::unix::{Library, RTLD_NOW};
use numpy::{Element, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use ocplanner_core::osc::Site;
use pyo3::prelude::*;

use crate::error::named;

/// Makes `dlopen` return only a library that is loaded already.
const RTLD_NOLOAD: c_int = if cfg!(target_vendor = "apple") { 0x10 } else { 0x4 };

type Version = unsafe extern "C" fn() -> c_int;
type Advance = unsafe extern "C" fn(*const c_void, *mut c_void);
type SiteJacobian = unsafe extern "C" fn(*const c_void, *const c_void, *mut f64, *mut f64, c_int);

/// A part of MuJoCo's step.
#[derive(Clone, Copy)]
pub enum Phase {
    Forward,
    Step,
    Step1,
    Step2,
}

/// The lengths of a model's arrays, by MuJoCo's names.
pub struct Sizes {
    pub nq: usize,
    pub nv: usize,
    pub nu: usize,
    pub nm: usize,
    pub nsite: usize,
    pub nbody: usize,
}

/// A model and its data, with the views that the control loop needs.
pub struct Simulation {
    mujoco: Mujoco,
    model: *const c_void,
    data: *mut c_void,
    pub sizes: Sizes,
    pub qpos: View<f64>,
    pub qvel: View<f64>,
    pub bias: View<f64>,
    pub inertia: View<f64>,
    control: View<f64>,
    control_range: View<f64>,
    site_position: View<f64>,
    site_rotation: View<f64>,
    /// Keep alive what the pointers point to.
    _owners: [Py<PyAny>; 2],
}

// SAFETY: the pointers are used through a mutable borrow of the simulation or, by the views' shared reads, while no
// mutable borrow exists; pyo3's borrow flag upholds both. MuJoCo may be called from any thread.
unsafe impl Send for Simulation {}
// SAFETY: as above; every method that calls MuJoCo or reads its memory is reached through `&mut ControlLoop` only.
unsafe impl Sync for Simulation {}

impl Simulation {
    /// Checks that model and data belong together, and takes the views.
    pub fn new(model: &Bound<'_, PyAny>, data: &Bound<'_, PyAny>) -> PyResult<Self> {
        let py = model.py();
        let mujoco = py.import("mujoco")?;
        for (name, object, class) in [("model", model, "MjModel"), ("data", data, "MjData")] {
            if !object.get_type().is(&mujoco.getattr(class)?) {
                let found = object.get_type().name()?;
                return Err(named(py, "InvalidValueError", format!("{name} is a {found}, expected mujoco.{class}")));
            }
        }
        let address = |object: &Bound<'_, PyAny>| object.getattr("_address")?.extract::<usize>();
        if address(&data.getattr("model")?)? != address(model)? {
            return Err(named(py, "InvalidValueError", "data belong to another model".to_owned()));
        }
        let size = |name: &str| model.getattr(name)?.extract::<usize>();
        let sizes = Sizes {
            nq: size("nq")?,
            nv: size("nv")?,
            nu: size("nu")?,
            nm: size("nM")?,
            nsite: size("nsite")?,
            nbody: size("nbody")?,
        };
        Ok(Self {
            mujoco: Mujoco::loaded(&mujoco)?,
            model: std::ptr::with_exposed_provenance(address(model)?),
            data: std::ptr::with_exposed_provenance_mut(address(data)?),
            qpos: View::of(data, "qpos", sizes.nq)?,
            qvel: View::of(data, "qvel", sizes.nv)?,
            bias: View::of(data, "qfrc_bias", sizes.nv)?,
            inertia: View::of(data, "qM", sizes.nm)?,
            control: View::of(data, "ctrl", sizes.nu)?,
            control_range: View::of(model, "actuator_ctrlrange", 2 * sizes.nu)?,
            site_position: View::of(data, "site_xpos", 3 * sizes.nsite)?,
            site_rotation: View::of(data, "site_xmat", 9 * sizes.nsite)?,
            sizes,
            _owners: [model.clone().unbind(), data.clone().unbind()],
        })
    }

    /// Whether both refer to the same `MjData`.
    pub fn same_data(&self, other: &Self) -> bool {
        std::ptr::eq(self.data, other.data)
    }

    /// The body to which a site is fixed.
    pub fn site_body(&self, model: &Bound<'_, PyAny>, site: usize) -> PyResult<usize> {
        let body = View::<i32>::of(model, "site_bodyid", self.sizes.nsite)?.get(site);
        Ok(usize::try_from(body)?)
    }

    /// Runs a part of MuJoCo's step.
    pub fn run(&mut self, phase: Phase) {
        let function = match phase {
            Phase::Forward => self.mujoco.forward,
            Phase::Step => self.mujoco.step,
            Phase::Step1 => self.mujoco.step1,
            Phase::Step2 => self.mujoco.step2,
        };
        // SAFETY: the addresses are those of a live MjModel and its own MjData, which `_owners` keeps alive, and the
        // function is that library's of this signature.
        unsafe { function(self.model, self.data) }
    }

    /// A site's pose; the velocity is left at zero.
    pub fn site(&self, site: usize) -> Site {
        Site {
            position: std::array::from_fn(|i| self.site_position.get(3 * site + i)),
            rotation: std::array::from_fn(|i| std::array::from_fn(|j| self.site_rotation.get(9 * site + 3 * i + j))),
            velocity: [0.0; 6],
        }
    }

    /// A site's velocity; writes its Jacobian to `jacobian` (6 x nv).
    pub fn site_velocity(&mut self, site: usize, jacobian: &mut [f64]) -> [f64; 6] {
        let nv = self.sizes.nv;
        assert!(jacobian.len() == 6 * nv && site < self.sizes.nsite, "checked when the loop was created");
        let (translation, rotation) = jacobian.split_at_mut(3 * nv);
        // SAFETY: as in `run`; MuJoCo writes 3 x nv numbers to each half, and the site exists.
        unsafe {
            (self.mujoco.site_jacobian)(
                self.model,
                self.data,
                translation.as_mut_ptr(),
                rotation.as_mut_ptr(),
                site as c_int,
            );
        }
        std::array::from_fn(|row| (0..nv).map(|k| jacobian[row * nv + k] * self.qvel.get(k)).sum())
    }

    /// Sets an actuator's command, clipped to its control range. NaN stays NaN.
    pub fn command(&mut self, actuator: usize, value: f64) {
        let (low, high) = (self.control_range.get(2 * actuator), self.control_range.get(2 * actuator + 1));
        let clipped = if value.is_nan() { value } else { value.max(low).min(high) };
        self.control.set(actuator, clipped);
    }
}

/// The functions of the loaded MuJoCo library.
struct Mujoco {
    forward: Advance,
    step: Advance,
    step1: Advance,
    step2: Advance,
    site_jacobian: SiteJacobian,
    /// Keeps the library loaded.
    _library: Library,
}

impl Mujoco {
    /// Finds the library that the Python module has loaded.
    fn loaded(module: &Bound<'_, PyModule>) -> PyResult<Self> {
        let py = module.py();
        let release: String = module.getattr("__version__")?.extract()?;
        let folder = PathBuf::from(module.filename()?.extract::<String>()?);
        let names = [format!("libmujoco.so.{release}"), format!("libmujoco.{release}.dylib")];
        let library = names
            .iter()
            .filter_map(|name| {
                let path = folder.parent()?.join(name);
                // SAFETY: with RTLD_NOLOAD nothing is loaded, so no initialiser runs.
                unsafe { Library::open(Some(path), RTLD_NOW | RTLD_NOLOAD) }.ok()
            })
            .next()
            .ok_or_else(|| {
                let message = format!(
                    "mujoco {release} has loaded no {} from its own folder; reinstall mujoco",
                    names.join(" or ")
                );
                named(py, "VersionError", message)
            })?;
        let missing = |error: libloading::Error| named(py, "VersionError", format!("mujoco {release}: {error}"));
        // SAFETY: the functions have these signatures in every MuJoCo from 2.1 to 3.9, and the version is checked below
        // before any other function is called.
        let (version, functions) = unsafe {
            let version = *library.get::<Version>(b"mj_version\0").map_err(missing)?;
            let functions = Self {
                forward: *library.get::<Advance>(b"mj_forward\0").map_err(missing)?,
                step: *library.get::<Advance>(b"mj_step\0").map_err(missing)?,
                step1: *library.get::<Advance>(b"mj_step1\0").map_err(missing)?,
                step2: *library.get::<Advance>(b"mj_step2\0").map_err(missing)?,
                site_jacobian: *library.get::<SiteJacobian>(b"mj_jacSite\0").map_err(missing)?,
                _library: library,
            };
            (version(), functions)
        };
        let expected: c_int = module.call_method0("mj_version")?.extract()?;
        if version != expected {
            let message = format!(
                "the loaded MuJoCo library is version {version}, but the mujoco module is {expected}; reinstall mujoco"
            );
            return Err(named(py, "VersionError", message));
        }
        Ok(functions)
    }
}

/// One of MuJoCo's arrays, through the NumPy view that its Python object provides.
pub struct View<T> {
    pointer: *mut T,
    length: usize,
    /// Keeps the memory alive.
    _array: Py<PyArrayDyn<T>>,
}

impl<T: Element + Copy> View<T> {
    /// The array `owner.name`, which must hold `length` elements of this type in C order.
    pub fn of(owner: &Bound<'_, PyAny>, name: &str, length: usize) -> PyResult<Self> {
        let py = owner.py();
        let attribute = owner.getattr(name)?;
        let array = attribute.cast::<PyArrayDyn<T>>().map_err(|_| {
            let dtype = T::get_dtype(py).typeobj().to_string();
            named(py, "ShapeError", format!("{name} is not an array of {dtype}"))
        })?;
        if !array.is_c_contiguous() || array.len() != length {
            let message = format!("{name}: shape is {:?}, expected {length} contiguous elements", array.shape());
            return Err(named(py, "ShapeError", message));
        }
        Ok(Self { pointer: array.data(), length, _array: array.clone().unbind() })
    }

    /// One element. Panics outside the array.
    pub fn get(&self, index: usize) -> T {
        assert!(index < self.length, "index {index} of {}", self.length);
        // SAFETY: inside the array, which `_array` keeps alive, and aligned, as NumPy's dtype promises.
        unsafe { self.pointer.add(index).read() }
    }

    fn set(&mut self, index: usize, value: T) {
        assert!(index < self.length, "index {index} of {}", self.length);
        // SAFETY: as in `get`; MuJoCo's arrays are writable.
        unsafe { self.pointer.add(index).write(value) }
    }
}
