//! The control loop of one arm inside MuJoCo: the package's only unsafe code.
//!
//! MuJoCo is called through the library that the imported `mujoco` module has already loaded, never through a second
//! copy, and only if both report the same version. `mjModel` and `mjData` stay opaque: their addresses come from the
//! Python objects, their arrays are read through the NumPy views that those objects hand out, so no struct layout is
//! assumed. What makes that sound:
//!
//! * The Python objects and the views are kept alive by the loop, and MuJoCo never moves the buffers behind the views.
//! * `MjModel` and `MjData` are checked to be those very classes and to belong together, every view to have the dtype,
//!   order and length that the model's sizes ask for, and every index to lie inside its array.
//! * An element is read or written through a raw pointer after a bounds check; no Rust reference to MuJoCo's memory
//!   outlives one element, so MuJoCo may write between two reads.
//! * The loop is borrowed mutably while it runs. As with `mujoco.mj_step`, which releases the GIL too, the caller must
//!   not step the same data from another thread meanwhile.
//!
//! A fatal MuJoCo error (an exhausted arena) ends the process with MuJoCo's own message; `mujoco.mj_step` would raise.
#![expect(unsafe_code, reason = "calls MuJoCo's C functions and reads its arrays, as justified above")]

use std::ffi::{c_int, c_void};
use std::path::PathBuf;

use libloading::os::unix::{Library, RTLD_NOW};
use numpy::{
    Element, IntoPyArray, PyArray1, PyArray2, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods,
};
use ocplanner_core::osc::{self, ActionFrame, ArmState, Gains, Goal, Joints, MAX_JOINTS, Site};
use pyo3::prelude::*;

use crate::arrays::view;
use crate::errors::{named, shape_error, to_python};

/// `dlopen` only what is loaded already.
const RTLD_NOLOAD: c_int = if cfg!(target_vendor = "apple") { 0x10 } else { 0x4 };

/// The most actuators a gripper may have.
const MAX_GRIPPER_ACTUATORS: usize = 16;

type Version = unsafe extern "C" fn() -> c_int;
type Advance = unsafe extern "C" fn(*const c_void, *mut c_void);
type SiteJacobian = unsafe extern "C" fn(*const c_void, *const c_void, *mut f64, *mut f64, c_int);

/// Adds this file's functions and classes to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<ControlLoop>()
}

/// What [`ControlLoop::measured`] returns: see there.
type Measured<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
);

/// One arm's control step, run natively.
///
/// A control step is `begin` (the first substep up to the actuators' commands) and `advance` (the rest of that substep
/// and the following ones). robosuite's `OSC_POSE` is computed in every substep by `ocplanner_core::osc`.
///
/// Args:
///     model: a `mujoco.MjModel`.
///     data: its `mujoco.MjData`.
///     eef_site: index of the site that is controlled.
///     base_site: index of the site whose frame an action is expressed in.
///     joint_qpos: indices of the arm's joints in `qpos`, at most 8.
///     joint_qvel: indices of the same joints in `qvel`.
///     arm_actuators: indices of the joints' torque actuators.
///     gripper_actuators: indices of the gripper's actuators.
///     world_frame: actions are expressed in the world frame instead of the base site's.
///     uncouple: position and orientation are controlled as if they did not couple.
///     lite_physics: `mj_step1` and `mj_step2` around the controller; otherwise `mj_forward` before and `mj_step` after.
///
/// Raises:
///     ShapeError: if the index lists' lengths differ or an array is not laid out as the model says.
///     InvalidValueError: if an index is outside its array, or the data belong to another model.
///     VersionError: if the loaded MuJoCo library is not found or its version is not the module's.
#[pyclass(module = "ocplanner._core")]
pub struct ControlLoop {
    plant: Plant,
}

#[pymethods]
impl ControlLoop {
    #[new]
    #[pyo3(signature = (model, data, *, eef_site, base_site, joint_qpos, joint_qvel, arm_actuators, gripper_actuators,
        world_frame=false, uncouple=true, lite_physics=true))]
    #[expect(clippy::too_many_arguments, reason = "keyword-only in Python")]
    fn new(
        model: &Bound<'_, PyAny>,
        data: &Bound<'_, PyAny>,
        eef_site: usize,
        base_site: usize,
        joint_qpos: Vec<usize>,
        joint_qvel: Vec<usize>,
        arm_actuators: Vec<usize>,
        gripper_actuators: Vec<usize>,
        world_frame: bool,
        uncouple: bool,
        lite_physics: bool,
    ) -> PyResult<Self> {
        let py = model.py();
        let simulation = Simulation::new(model, data)?;
        let joints = joint_qpos.len();
        let state = ArmState::new(joints).map_err(|error| to_python(py, &error))?;
        for (name, list) in [("joint_qvel", &joint_qvel), ("arm_actuators", &arm_actuators)] {
            if list.len() != joints {
                let message = format!("{name} has {} indices, joint_qpos has {joints}", list.len());
                return Err(named(py, "ShapeError", message));
            }
        }
        let sizes = &simulation.sizes;
        for (name, list, size) in [
            ("eef_site", &vec![eef_site], sizes.nsite),
            ("base_site", &vec![base_site], sizes.nsite),
            ("joint_qpos", &joint_qpos, sizes.nq),
            ("joint_qvel", &joint_qvel, sizes.nv),
            ("arm_actuators", &arm_actuators, sizes.nu),
            ("gripper_actuators", &gripper_actuators, sizes.nu),
        ] {
            if let Some(index) = list.iter().find(|index| **index >= size) {
                return Err(named(py, "InvalidValueError", format!("{name}: {index} is not below {size}")));
            }
        }
        if gripper_actuators.len() > MAX_GRIPPER_ACTUATORS {
            let message =
                format!("gripper_actuators: {} is more than {MAX_GRIPPER_ACTUATORS}", gripper_actuators.len());
            return Err(named(py, "InvalidValueError", message));
        }
        let base_body = simulation.site_body(model, base_site)?;
        let base_moves = View::<i32>::of(model, "body_weldid", sizes.nbody)?.get(base_body) != 0;
        let inertia_entries = inertia_entries(model, sizes, &joint_qvel)?;
        let nv = sizes.nv;
        Ok(Self {
            plant: Plant {
                simulation,
                eef_site,
                base_site,
                base_moves,
                joint_qpos,
                joint_qvel,
                inertia_entries,
                gripper: vec![0.0; gripper_actuators.len()],
                arm_actuators,
                gripper_actuators,
                frame: if world_frame { ActionFrame::World } else { ActionFrame::Base },
                lite_physics,
                jacobian: vec![0.0; 6 * nv],
                state,
                base: Site::ORIGIN,
                goal: Goal { position: [0.0; 3], rotation: Site::ORIGIN.rotation },
                gains: Gains { stiffness: [0.0; 6], damping: [0.0; 6], uncouple },
                posture: [0.0; MAX_JOINTS],
                torques: [0.0; MAX_JOINTS],
                remembered: false,
                has_goal: false,
                begun: false,
            },
        })
    }

    /// Begins a control step: the first substep's kinematics, the goal, the torques and the actuators' commands.
    ///
    /// Args:
    ///     delta: (6,) float64, the displacement of the goal: metres, then axis times angle in radians.
    ///     gripper: (gripper actuators,) float64, the gripper's commands, clipped to their control range.
    ///     stiffness: (6,) float64, 1/s^2.
    ///     damping: (6,) float64, 1/s.
    ///     posture: (joints,) float64, the joint positions that the null space tends to, rad.
    ///
    /// Raises:
    ///     ShapeError: if an array's length differs.
    ///     InvalidValueError: if a number is not finite.
    fn begin(
        &mut self,
        py: Python<'_>,
        delta: &Bound<'_, PyAny>,
        gripper: &Bound<'_, PyAny>,
        stiffness: &Bound<'_, PyAny>,
        damping: &Bound<'_, PyAny>,
        posture: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let plant = &mut self.plant;
        let joints = plant.state.joints;
        let delta = numbers::<6>("delta", delta, 6)?;
        plant.gains.stiffness = numbers::<6>("stiffness", stiffness, 6)?;
        plant.gains.damping = numbers::<6>("damping", damping, 6)?;
        plant.posture = numbers::<MAX_JOINTS>("posture", posture, joints)?;
        let count = plant.gripper.len();
        let command = numbers::<MAX_GRIPPER_ACTUATORS>("gripper", gripper, count)?;
        plant.gripper.copy_from_slice(&command[..count]);
        py.detach(|| plant.begin(&delta));
        Ok(())
    }

    /// Runs `substeps` substeps of the control step, the one begun included.
    ///
    /// Raises:
    ///     InvalidValueError: before the first `begin`.
    fn advance(&mut self, py: Python<'_>, substeps: usize) -> PyResult<()> {
        if !self.plant.has_goal {
            return Err(named(py, "InvalidValueError", "advance: no control step has begun".to_owned()));
        }
        let plant = &mut self.plant;
        py.detach(|| plant.advance(substeps));
        Ok(())
    }

    /// What the controller measured last, world frame: the end effector's position (3,) m, rotation (3, 3) and velocity
    /// (6,), its Jacobian (6, joints), the inertia (joints, joints), and the joints' positions and velocities (joints,).
    fn measured<'py>(&self, py: Python<'py>) -> PyResult<Measured<'py>> {
        let state = &self.plant.state;
        let n = state.joints;
        let matrix = |rows: &[Joints]| -> PyResult<Bound<'py, PyArray2<f64>>> {
            let flat: Vec<f64> = rows.iter().flat_map(|row| row[..n].iter().copied()).collect();
            flat.into_pyarray(py).reshape([rows.len(), n])
        };
        Ok((
            PyArray1::from_slice(py, &state.eef.position),
            PyArray1::from_slice(py, state.eef.rotation.as_flattened()).reshape([3, 3])?,
            PyArray1::from_slice(py, &state.eef.velocity),
            matrix(&state.jacobian)?,
            matrix(&state.inertia[..n])?,
            PyArray1::from_slice(py, &state.position[..n]),
            PyArray1::from_slice(py, &state.velocity[..n]),
        ))
    }

    /// Makes the next `begin` use this measurement instead of the simulation's state, as robosuite does in the first
    /// substep after a reset. The arguments are those that `measured` returns, float64.
    ///
    /// Raises:
    ///     ShapeError: if an array has another shape.
    ///     InvalidValueError: if a number is not finite.
    #[expect(clippy::too_many_arguments, reason = "the parts of one measurement")]
    fn remember(
        &mut self,
        py: Python<'_>,
        position: &Bound<'_, PyAny>,
        rotation: &Bound<'_, PyAny>,
        velocity: &Bound<'_, PyAny>,
        jacobian: &Bound<'_, PyAny>,
        inertia: &Bound<'_, PyAny>,
        joint_position: &Bound<'_, PyAny>,
        joint_velocity: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let joints = self.plant.state.joints;
        let mut state = ArmState::new(joints).map_err(|error| to_python(py, &error))?;
        state.eef = Site {
            position: numbers::<3>("position", position, 3)?,
            rotation: rows("rotation", rotation, &[3, 3])?,
            velocity: numbers::<6>("velocity", velocity, 6)?,
        };
        state.jacobian = rows("jacobian", jacobian, &[6, joints])?;
        state.inertia = rows("inertia", inertia, &[joints, joints])?;
        state.position = numbers::<MAX_JOINTS>("joint_position", joint_position, joints)?;
        state.velocity = numbers::<MAX_JOINTS>("joint_velocity", joint_velocity, joints)?;
        self.plant.state = state;
        self.plant.remembered = true;
        Ok(())
    }

    /// (3,) float64: the goal's position in the frame of the actions, metres.
    #[getter]
    fn goal_position<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.plant.goal.position)
    }

    /// (3, 3) float64: the goal's rotation, end effector -> frame of the actions.
    #[getter]
    fn goal_rotation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        PyArray1::from_slice(py, self.plant.goal.rotation.as_flattened()).reshape([3, 3])
    }

    /// (joints,) float64: the torques computed last, gravity compensation included, before clipping, N m.
    #[getter]
    fn torques<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.plant.torques[..self.plant.state.joints])
    }
}

/// The arm, its controller and what it last measured.
struct Plant {
    simulation: Simulation,
    eef_site: usize,
    base_site: usize,
    /// Whether the base site's velocity is not zero by construction.
    base_moves: bool,
    joint_qpos: Vec<usize>,
    joint_qvel: Vec<usize>,
    /// (row, column, address in `qM`) of the arm's inertia on and below the diagonal.
    inertia_entries: Vec<(usize, usize, usize)>,
    arm_actuators: Vec<usize>,
    gripper_actuators: Vec<usize>,
    gripper: Vec<f64>,
    frame: ActionFrame,
    lite_physics: bool,
    /// Translational and rotational site Jacobian, each 3 x nv.
    jacobian: Vec<f64>,
    state: ArmState,
    base: Site,
    goal: Goal,
    gains: Gains,
    posture: Joints,
    torques: Joints,
    /// `state` was given and holds for the next substep.
    remembered: bool,
    /// Some control step has begun.
    has_goal: bool,
    /// A substep's commands are set, the physics has yet to follow.
    begun: bool,
}

impl Plant {
    fn begin(&mut self, delta: &[f64; 6]) {
        self.measure();
        self.goal = osc::goal(&self.state.eef, &self.base, self.frame, delta);
        self.actuate();
        (self.has_goal, self.begun) = (true, true);
    }

    fn advance(&mut self, substeps: usize) {
        for _ in 0..substeps {
            if !self.begun {
                self.measure();
                self.actuate();
            }
            self.begun = false;
            self.simulation.run(if self.lite_physics { Phase::Step2 } else { Phase::Step });
        }
    }

    /// The substep's kinematics and what the controller sees of them.
    fn measure(&mut self) {
        self.simulation.run(if self.lite_physics { Phase::Step1 } else { Phase::Forward });
        let remembered = std::mem::take(&mut self.remembered);
        if !self.lite_physics && !remembered {
            // robosuite's controller runs it once more before it reads.
            self.simulation.run(Phase::Forward);
        }
        self.base = self.simulation.site(self.base_site);
        if self.base_moves {
            self.base.velocity = self.simulation.site_velocity(self.base_site, &mut self.jacobian);
        }
        if remembered {
            return;
        }
        let state = &mut self.state;
        state.eef = self.simulation.site(self.eef_site);
        state.eef.velocity = self.simulation.site_velocity(self.eef_site, &mut self.jacobian);
        let nv = self.simulation.sizes.nv;
        for (j, (qpos, qvel)) in self.joint_qpos.iter().zip(&self.joint_qvel).enumerate() {
            state.position[j] = self.simulation.qpos.get(*qpos);
            state.velocity[j] = self.simulation.qvel.get(*qvel);
            for row in 0..6 {
                state.jacobian[row][j] = self.jacobian[row * nv + qvel];
            }
        }
        for (i, j, address) in &self.inertia_entries {
            let value = self.simulation.inertia.get(*address);
            (state.inertia[*i][*j], state.inertia[*j][*i]) = (value, value);
        }
    }

    /// Commands the arm's torques and the gripper.
    fn actuate(&mut self) {
        self.torques = osc::torques(&self.state, &self.base, self.frame, &self.goal, &self.gains, &self.posture);
        for (j, (qvel, actuator)) in self.joint_qvel.iter().zip(&self.arm_actuators).enumerate() {
            self.torques[j] += self.simulation.bias.get(*qvel);
            self.simulation.command(*actuator, self.torques[j]);
        }
        for (actuator, value) in self.gripper_actuators.iter().zip(&self.gripper) {
            self.simulation.command(*actuator, *value);
        }
    }
}

/// A part of MuJoCo's step.
#[derive(Clone, Copy)]
enum Phase {
    Forward,
    Step,
    Step1,
    Step2,
}

struct Sizes {
    nq: usize,
    nv: usize,
    nu: usize,
    nm: usize,
    nsite: usize,
    nbody: usize,
}

/// A model and its data, with the views that the loop needs.
struct Simulation {
    mujoco: Mujoco,
    model: *const c_void,
    data: *mut c_void,
    sizes: Sizes,
    qpos: View<f64>,
    qvel: View<f64>,
    bias: View<f64>,
    inertia: View<f64>,
    control: View<f64>,
    control_range: View<f64>,
    site_position: View<f64>,
    site_rotation: View<f64>,
    /// Keeps what the pointers point to alive.
    _owners: [Py<PyAny>; 2],
}

// SAFETY: the pointers are used by whoever borrows the simulation mutably, or, for the views' shared reads, while no
// mutable borrow exists; pyo3's borrow flag upholds both. MuJoCo itself does not care which thread calls it.
unsafe impl Send for Simulation {}
// SAFETY: as above; every method that calls MuJoCo or reads its memory is reached through `&mut ControlLoop` only.
unsafe impl Sync for Simulation {}

impl Simulation {
    fn new(model: &Bound<'_, PyAny>, data: &Bound<'_, PyAny>) -> PyResult<Self> {
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

    fn site_body(&self, model: &Bound<'_, PyAny>, site: usize) -> PyResult<usize> {
        let body = View::<i32>::of(model, "site_bodyid", self.sizes.nsite)?.get(site);
        Ok(usize::try_from(body)?)
    }

    fn run(&mut self, phase: Phase) {
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

    /// A site's pose; its velocity is left zero.
    fn site(&self, site: usize) -> Site {
        Site {
            position: std::array::from_fn(|i| self.site_position.get(3 * site + i)),
            rotation: std::array::from_fn(|i| std::array::from_fn(|j| self.site_rotation.get(9 * site + 3 * i + j))),
            velocity: [0.0; 6],
        }
    }

    /// A site's velocity; its Jacobian is left in `jacobian` (6 x nv).
    fn site_velocity(&mut self, site: usize, jacobian: &mut [f64]) -> [f64; 6] {
        let nv = self.sizes.nv;
        assert!(jacobian.len() == 6 * nv && site < self.sizes.nsite, "checked when the loop was made");
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

    /// Sets an actuator's command, clipped to its control range; NaN stays.
    fn command(&mut self, actuator: usize, value: f64) {
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
                let message = format!("mujoco {release} has loaded no {} beside its module", names.join(" or "));
                named(py, "VersionError", message)
            })?;
        let missing = |error: libloading::Error| named(py, "VersionError", format!("mujoco {release}: {error}"));
        // SAFETY: these are the functions' signatures in every MuJoCo from 2.1 to 3.9; the version is checked below
        // before any other is called.
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
            let message = format!("the loaded MuJoCo library is version {version}, the mujoco module {expected}");
            return Err(named(py, "VersionError", message));
        }
        Ok(functions)
    }
}

/// One of MuJoCo's arrays, through the NumPy view that its Python object hands out.
struct View<T> {
    pointer: *mut T,
    length: usize,
    /// Keeps the memory alive.
    _array: Py<PyArrayDyn<T>>,
}

impl<T: Element + Copy> View<T> {
    /// The array `owner.name`, which must hold `length` elements of this type in C order.
    fn of(owner: &Bound<'_, PyAny>, name: &str, length: usize) -> PyResult<Self> {
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

    fn get(&self, index: usize) -> T {
        assert!(index < self.length, "index {index} of {}", self.length);
        // SAFETY: inside the array, which `_array` keeps alive, and aligned since NumPy says so for this dtype.
        unsafe { self.pointer.add(index).read() }
    }

    fn set(&mut self, index: usize, value: T) {
        assert!(index < self.length, "index {index} of {}", self.length);
        // SAFETY: as in `get`; MuJoCo's arrays are writable.
        unsafe { self.pointer.add(index).write(value) }
    }
}

/// Where the arm's inertia stands in `qM`: row i holds the element of degree of freedom i, then of its ancestors.
fn inertia_entries(
    model: &Bound<'_, PyAny>,
    sizes: &Sizes,
    joint_qvel: &[usize],
) -> PyResult<Vec<(usize, usize, usize)>> {
    let start = View::<i32>::of(model, "dof_Madr", sizes.nv)?;
    let parent = View::<i32>::of(model, "dof_parentid", sizes.nv)?;
    let mut entries = Vec::new();
    for (i, dof) in joint_qvel.iter().enumerate() {
        let mut address = usize::try_from(start.get(*dof))?;
        let mut ancestor = Some(*dof);
        while let Some(current) = ancestor {
            if let Some(j) = joint_qvel.iter().position(|other| *other == current) {
                entries.push((i, j, address));
            }
            address += 1;
            ancestor = usize::try_from(parent.get(current)).ok();
        }
    }
    Ok(entries)
}

/// A vector of `length` finite numbers, padded with zeros.
fn numbers<const N: usize>(what: &str, value: &Bound<'_, PyAny>, length: usize) -> PyResult<[f64; N]> {
    let [row] = rows(what, value, &[length])?;
    Ok(row)
}

/// Finite numbers in an array of this shape, row by row, padded with zeros.
fn rows<const R: usize, const C: usize>(
    what: &str,
    value: &Bound<'_, PyAny>,
    shape: &[usize],
) -> PyResult<[[f64; C]; R]> {
    let array = view::<f64>(what, value, &format!("{shape:?}"), shape)?;
    let values = array.as_slice()?;
    let py = value.py();
    if array.ndim() != shape.len() {
        return Err(shape_error(py, format!("{what}: expected shape {shape:?}, found {:?}", array.shape())));
    }
    if let Some(number) = values.iter().find(|number| !number.is_finite()) {
        return Err(named(py, "InvalidValueError", format!("{what}: {number} is not finite")));
    }
    let columns = shape.last().copied().unwrap_or(0);
    let mut padded = [[0.0; C]; R];
    for (to, from) in padded.iter_mut().zip(values.chunks_exact(columns.max(1))) {
        to[..columns].copy_from_slice(from);
    }
    Ok(padded)
}
