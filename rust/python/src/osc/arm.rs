//! One arm under control in MuJoCo: what the controller measures in each substep, and what it commands. Of several arms in
//! one simulation, the first runs the physics, and the others compute their torques in the same substeps.

use ocplanner_core::osc::{self, ActionFrame, ArmState, Gains, Goal, Joints, MAX_JOINTS, Site};
use pyo3::prelude::*;

use crate::error::{named, to_python};
use crate::mujoco::{Phase, Simulation, Sizes, View};

/// The largest number of actuators a gripper may have.
pub const MAX_GRIPPER_ACTUATORS: usize = 16;

/// Which parts of the model are controlled, and how.
pub struct Wiring {
    /// The controlled site.
    pub eef_site: usize,
    /// The site in whose frame actions may be expressed.
    pub base_site: usize,
    /// The arm's joints in `qpos`.
    pub joint_qpos: Vec<usize>,
    /// The same joints in `qvel`.
    pub joint_qvel: Vec<usize>,
    /// The joints' torque actuators.
    pub arm_actuators: Vec<usize>,
    /// The gripper's actuators, at most [`MAX_GRIPPER_ACTUATORS`].
    pub gripper_actuators: Vec<usize>,
    /// The frame of the actions.
    pub frame: ActionFrame,
    /// Position and orientation are controlled as if they did not couple.
    pub uncouple: bool,
    /// `mj_step1` and `mj_step2` around the controller; otherwise `mj_forward` before and `mj_step` after.
    pub lite_physics: bool,
}

impl Wiring {
    /// Raises `InvalidValueError` or `ShapeError` unless the lists fit each other and each index lies inside its array.
    fn check(&self, py: Python<'_>, sizes: &Sizes) -> PyResult<()> {
        let joints = self.joint_qpos.len();
        for (name, list) in [("joint_qvel", &self.joint_qvel), ("arm_actuators", &self.arm_actuators)] {
            if list.len() != joints {
                let message = format!("{name} has {} indices, joint_qpos has {joints}", list.len());
                return Err(named(py, "ShapeError", message));
            }
        }
        for (name, list, size) in [
            ("eef_site", &vec![self.eef_site], sizes.nsite),
            ("base_site", &vec![self.base_site], sizes.nsite),
            ("joint_qpos", &self.joint_qpos, sizes.nq),
            ("joint_qvel", &self.joint_qvel, sizes.nv),
            ("arm_actuators", &self.arm_actuators, sizes.nu),
            ("gripper_actuators", &self.gripper_actuators, sizes.nu),
        ] {
            if let Some(index) = list.iter().find(|index| **index >= size) {
                return Err(named(py, "InvalidValueError", format!("{name}: {index} is not below {size}")));
            }
        }
        let fingers = self.gripper_actuators.len();
        if fingers > MAX_GRIPPER_ACTUATORS {
            let message = format!("gripper_actuators: found {fingers}, expected at most {MAX_GRIPPER_ACTUATORS}");
            return Err(named(py, "InvalidValueError", message));
        }
        Ok(())
    }
}

/// An arm, its controller and the last measurement.
pub struct ControlledArm {
    simulation: Simulation,
    wiring: Wiring,
    /// Whether the base site can move: otherwise its velocity is zero by construction.
    base_moves: bool,
    /// (row, column, address in `qM`) of the arm's inertia on and below the diagonal.
    inertia_entries: Vec<(usize, usize, usize)>,
    /// Translational and rotational site Jacobian, each 3 x nv.
    jacobian: Vec<f64>,
    base: Site,
    /// The controller's last measurement.
    pub state: ArmState,
    /// The pose to reach, in the frame of the actions.
    pub goal: Goal,
    /// The controller's gains.
    pub gains: Gains,
    /// The joint positions toward which the null space moves, rad.
    pub posture: Joints,
    /// The gripper's commands.
    pub gripper: Vec<f64>,
    /// The torques computed last, N m.
    pub torques: Joints,
    /// `state` was given from outside, for the next substep.
    remembered: bool,
    /// A control step has begun at some time.
    has_goal: bool,
    /// A substep's commands are set, and its physics has not run yet.
    begun: bool,
    /// Another arm runs the physics.
    led: bool,
}

impl ControlledArm {
    /// Wires a controller to a `mujoco.MjModel` and its `mujoco.MjData`.
    pub fn new(model: &Bound<'_, PyAny>, data: &Bound<'_, PyAny>, wiring: Wiring) -> PyResult<Self> {
        let py = model.py();
        let simulation = Simulation::new(model, data)?;
        let sizes = &simulation.sizes;
        let state = ArmState::new(wiring.joint_qpos.len()).map_err(|error| to_python(py, &error))?;
        wiring.check(py, sizes)?;
        let base_body = simulation.site_body(model, wiring.base_site)?;
        Ok(Self {
            base_moves: View::<i32>::of(model, "body_weldid", sizes.nbody)?.get(base_body) != 0,
            inertia_entries: inertia_entries(model, sizes, &wiring.joint_qvel)?,
            jacobian: vec![0.0; 6 * sizes.nv],
            base: Site::ORIGIN,
            state,
            goal: Goal { position: [0.0; 3], rotation: Site::ORIGIN.rotation },
            gains: Gains { stiffness: [0.0; 6], damping: [0.0; 6], uncouple: wiring.uncouple },
            posture: [0.0; MAX_JOINTS],
            gripper: vec![0.0; wiring.gripper_actuators.len()],
            torques: [0.0; MAX_JOINTS],
            remembered: false,
            has_goal: false,
            begun: false,
            led: false,
            simulation,
            wiring,
        })
    }

    /// Whether a control step has begun, so that [`ControlledArm::advance`] has a goal.
    pub fn has_goal(&self) -> bool {
        self.has_goal
    }

    /// Whether another arm runs the physics.
    pub fn is_led(&self) -> bool {
        self.led
    }

    /// Leaves the physics to another arm of the same simulation, or says why that is impossible.
    pub fn join(&mut self, leader: &ControlledArm) -> Result<(), &'static str> {
        if !self.simulation.same_data(&leader.simulation) {
            return Err("the loops' data differ");
        }
        if self.led || leader.led {
            return Err("one of the loops was added to another before");
        }
        if !(self.wiring.lite_physics && leader.wiring.lite_physics) {
            return Err("several arms need lite_physics");
        }
        self.led = true;
        Ok(())
    }

    /// Makes the next [`ControlledArm::begin`] use this measurement instead of the simulation's state.
    pub fn remember(&mut self, state: ArmState) {
        (self.state, self.remembered) = (state, true);
    }

    /// The first substep up to the actuators' commands, for a goal displaced by `delta`. An arm that is led begins
    /// after its leader, which runs the substep's kinematics.
    pub fn begin(&mut self, delta: &[f64; 6]) {
        self.measure();
        self.goal = osc::goal(&self.state.eef, &self.base, self.wiring.frame, delta);
        self.actuate();
        (self.has_goal, self.begun) = (true, true);
    }

    /// Runs substeps, including the one begun, together with the arms that this one leads.
    pub fn advance(&mut self, substeps: usize, led: &mut [&mut ControlledArm]) {
        for _ in 0..substeps {
            if !self.begun {
                self.measure();
                self.actuate();
                for arm in led.iter_mut() {
                    arm.measure();
                    arm.actuate();
                }
            }
            self.begun = false;
            self.simulation.run(if self.wiring.lite_physics { Phase::Step2 } else { Phase::Step });
        }
    }

    /// The substep's kinematics and what the controller sees of them.
    fn measure(&mut self) {
        if !self.led {
            self.simulation.run(if self.wiring.lite_physics { Phase::Step1 } else { Phase::Forward });
        }
        let remembered = std::mem::take(&mut self.remembered);
        if !self.wiring.lite_physics && !remembered {
            // robosuite's controller runs it once more before it reads the state.
            self.simulation.run(Phase::Forward);
        }
        self.base = self.simulation.site(self.wiring.base_site);
        if self.base_moves {
            self.base.velocity = self.simulation.site_velocity(self.wiring.base_site, &mut self.jacobian);
        }
        if remembered {
            return;
        }
        let state = &mut self.state;
        state.eef = self.simulation.site(self.wiring.eef_site);
        state.eef.velocity = self.simulation.site_velocity(self.wiring.eef_site, &mut self.jacobian);
        let nv = self.simulation.sizes.nv;
        for (j, (qpos, qvel)) in self.wiring.joint_qpos.iter().zip(&self.wiring.joint_qvel).enumerate() {
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
        self.torques = osc::torques(&self.state, &self.base, self.wiring.frame, &self.goal, &self.gains, &self.posture);
        for (j, (qvel, actuator)) in self.wiring.joint_qvel.iter().zip(&self.wiring.arm_actuators).enumerate() {
            self.torques[j] += self.simulation.bias.get(*qvel);
            self.simulation.command(*actuator, self.torques[j]);
        }
        for (actuator, value) in self.wiring.gripper_actuators.iter().zip(&self.gripper) {
            self.simulation.command(*actuator, *value);
        }
    }
}

/// Where the arm's inertia lies in `qM`: row i holds the element of degree of freedom i, then those of its ancestors.
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
