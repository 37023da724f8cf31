//! Bindings of `ocplanner_core::osc`: the control loop of one arm inside MuJoCo, or of several together.

mod arm;

use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods, PyUntypedArrayMethods};
use ocplanner_core::osc::{ActionFrame, ArmState, Joints, MAX_JOINTS, Site};
use pyo3::prelude::*;

use crate::arguments::{count, counts};
use crate::arrays::view;
use crate::error::{named, shape_error, to_python};
use arm::{ControlledArm, MAX_GRIPPER_ACTUATORS, Wiring};

/// What [`ControlLoop::measured`] returns.
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
/// A control step is `begin` (the first substep up to the actuators' commands) and then `advance` (the rest of that substep
/// and the following ones). Every substep computes robosuite's `OSC_POSE`.
///
/// Args:
///     model: a `mujoco.MjModel`.
///     data: its `mujoco.MjData`.
///     eef_site: index of the controlled site.
///     base_site: index of the site in whose frame actions are expressed.
///     joint_qpos: indices of the arm's joints in `qpos`, at most 8.
///     joint_qvel: indices of the same joints in `qvel`.
///     arm_actuators: indices of the joints' torque actuators.
///     gripper_actuators: indices of the gripper's actuators.
///     world_frame: actions are expressed in the world frame instead of the base site's.
///     uncouple: position and orientation are controlled as if they did not couple.
///     lite_physics: `mj_step1` and `mj_step2` around the controller; otherwise `mj_forward` before and `mj_step` after.
///
/// Raises:
///     ShapeError: the index lists differ in length, or an array is not laid out as the model says.
///     InvalidValueError: an index is outside its array, or the data belong to another model.
///     VersionError: the loaded MuJoCo library is not found, or its version is not the module's.
#[pyclass(module = "ocplanner._core")]
pub struct ControlLoop {
    arm: ControlledArm,
    /// Loops of further arms, which run with this one.
    others: Vec<Py<ControlLoop>>,
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
        #[pyo3(from_py_with = count)] eef_site: usize,
        #[pyo3(from_py_with = count)] base_site: usize,
        #[pyo3(from_py_with = counts)] joint_qpos: Vec<usize>,
        #[pyo3(from_py_with = counts)] joint_qvel: Vec<usize>,
        #[pyo3(from_py_with = counts)] arm_actuators: Vec<usize>,
        #[pyo3(from_py_with = counts)] gripper_actuators: Vec<usize>,
        world_frame: bool,
        uncouple: bool,
        lite_physics: bool,
    ) -> PyResult<Self> {
        let wiring = Wiring {
            eef_site,
            base_site,
            joint_qpos,
            joint_qvel,
            arm_actuators,
            gripper_actuators,
            frame: if world_frame { ActionFrame::World } else { ActionFrame::Base },
            uncouple,
            lite_physics,
        };
        Ok(Self { arm: ControlledArm::new(model, data, wiring)?, others: Vec::new() })
    }

    /// Runs the loop of another arm on the same data together with this one from now on.
    ///
    /// In each control step `begin` this loop, then the others, then `advance` this one alone.
    ///
    /// Raises:
    ///     InvalidValueError: the other loop's data differ, it is this loop, one of the two was added to a loop before,
    ///         the other has loops of its own, or `lite_physics` is off.
    fn add(&mut self, other: &Bound<'_, Self>) -> PyResult<()> {
        let py = other.py();
        let refuse = |why: &str| named(py, "InvalidValueError", format!("add: {why}"));
        let mut added = other.try_borrow_mut().map_err(|_| refuse("a loop cannot be added to itself"))?;
        if !added.others.is_empty() {
            return Err(refuse("the loop has loops of its own"));
        }
        added.arm.join(&self.arm).map_err(refuse)?;
        self.others.push(other.clone().unbind());
        Ok(())
    }

    /// Begins a control step: the first substep's kinematics, the goal, the torques and the actuators' commands.
    ///
    /// Args:
    ///     delta: (6,) float64, the displacement of the goal: metres, then axis times angle in radians.
    ///     gripper: (gripper actuators,) float64, the gripper's commands, clipped to their control range.
    ///     stiffness: (6,) float64, 1/s^2.
    ///     damping: (6,) float64, 1/s.
    ///     posture: (joints,) float64, the joint positions toward which the null space moves, rad.
    ///
    /// Raises:
    ///     ShapeError: an array has another length.
    ///     InvalidValueError: a number is not finite.
    fn begin(
        &mut self,
        py: Python<'_>,
        delta: &Bound<'_, PyAny>,
        gripper: &Bound<'_, PyAny>,
        stiffness: &Bound<'_, PyAny>,
        damping: &Bound<'_, PyAny>,
        posture: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let arm = &mut self.arm;
        let joints = arm.state.joints;
        let delta = numbers::<6>("delta", delta, 6)?;
        arm.gains.stiffness = numbers::<6>("stiffness", stiffness, 6)?;
        arm.gains.damping = numbers::<6>("damping", damping, 6)?;
        arm.posture = numbers::<MAX_JOINTS>("posture", posture, joints)?;
        let count = arm.gripper.len();
        let command = numbers::<MAX_GRIPPER_ACTUATORS>("gripper", gripper, count)?;
        arm.gripper.copy_from_slice(&command[..count]);
        py.detach(|| arm.begin(&delta));
        Ok(())
    }

    /// Runs `substeps` substeps, including the one begun, of this arm and of those added to it.
    ///
    /// Raises:
    ///     InvalidValueError: one of them has not begun a control step, or this loop was added to another.
    fn advance(&mut self, py: Python<'_>, #[pyo3(from_py_with = count)] substeps: usize) -> PyResult<()> {
        let refuse = |why: &str| named(py, "InvalidValueError", format!("advance: {why}"));
        if self.arm.is_led() {
            return Err(refuse("the loop was added to another, which advances both"));
        }
        let mut others = Vec::with_capacity(self.others.len());
        for other in &self.others {
            others.push(other.try_borrow_mut(py).map_err(|_| refuse("an added loop is in use"))?);
        }
        if !self.arm.has_goal() || others.iter().any(|other| !other.arm.has_goal()) {
            return Err(refuse("no control step has begun"));
        }
        let arm = &mut self.arm;
        let mut led: Vec<&mut ControlledArm> = others.iter_mut().map(|other| &mut other.arm).collect();
        py.detach(|| arm.advance(substeps, &mut led));
        Ok(())
    }

    /// The controller's last measurement, world frame: the end effector's position (3,) m, rotation (3, 3) and velocity
    /// (6,), its Jacobian (6, joints), the inertia (joints, joints), and the joints' positions and velocities (joints,).
    fn measured<'py>(&self, py: Python<'py>) -> PyResult<Measured<'py>> {
        let state = &self.arm.state;
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
    /// substep after a reset. The arguments are what `measured` returns, float64.
    ///
    /// Raises:
    ///     ShapeError: an array has another shape.
    ///     InvalidValueError: a number is not finite.
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
        let joints = self.arm.state.joints;
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
        self.arm.remember(state);
        Ok(())
    }

    /// (3,) float64: the goal's position in the frame of the actions, metres.
    #[getter]
    fn goal_position<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.arm.goal.position)
    }

    /// (3, 3) float64: the goal's rotation, end effector -> frame of the actions.
    #[getter]
    fn goal_rotation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        PyArray1::from_slice(py, self.arm.goal.rotation.as_flattened()).reshape([3, 3])
    }

    /// (joints,) float64: the torques computed last, gravity compensation included, before clipping, N m.
    #[getter]
    fn torques<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.arm.torques[..self.arm.state.joints])
    }
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
