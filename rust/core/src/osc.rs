//! Operational-space control of one arm, as robosuite's `OSC_POSE` computes it (Khatib 1987).
//!
//! The torques agree with robosuite's to rounding, so its conventions are kept where they matter: the goal is expressed in
//! the arm's base frame, orientation errors are sums of cross products of the axes, the inertias of position and of
//! orientation are inverted separately, and a goal rotation passes through single precision ([`goal_rotation`]).
//!
//! Positions are in metres, velocities in m/s and rad/s, torques in N m; rotations map the named frame to the world.
//! Wrenches, velocities and gains list translation before rotation.

use faer::{Mat, Side};

use crate::error::{Error, Result};
use crate::pose::{IDENTITY, Matrix3, Vector3, add, cross, multiply, rotate, scale, subtract, transpose};

/// The largest number of joints an arm may have.
pub const MAX_JOINTS: usize = 8;

/// One number per joint; entries beyond the arm's joints are zero.
pub type Joints = [f64; MAX_JOINTS];

/// Stiffness with which the redundant joints keep their posture, 1/s^2: robosuite's constant.
const POSTURE_STIFFNESS: f64 = 10.0;

/// The frame in which an action's displacement is expressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ActionFrame {
    /// The frame of the arm's base site; the goal moves with it.
    Base,
    /// The world frame.
    World,
}

/// Pose and velocity of a site in the world frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Site {
    /// Its origin, metres.
    pub position: Vector3,
    /// Site -> world.
    pub rotation: Matrix3,
    /// Its linear and angular velocity, m/s and rad/s.
    pub velocity: [f64; 6],
}

/// What the controller measures of an arm at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct ArmState {
    /// Number of joints, at most [`MAX_JOINTS`].
    pub joints: usize,
    /// The end effector.
    pub eef: Site,
    /// Joint positions, rad.
    pub position: Joints,
    /// Joint velocities, rad/s.
    pub velocity: Joints,
    /// The end effector's velocity per joint velocity: 6 x joints.
    pub jacobian: [Joints; 6],
    /// The joint-space inertia: joints x joints, symmetric.
    pub inertia: [Joints; MAX_JOINTS],
}

/// A pose to reach, in the frame of the action.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Goal {
    /// Metres.
    pub position: Vector3,
    /// End effector -> frame of the action.
    pub rotation: Matrix3,
}

/// The controller's constants.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gains {
    /// Stiffness, 1/s^2.
    pub stiffness: [f64; 6],
    /// Damping, 1/s.
    pub damping: [f64; 6],
    /// Whether position and orientation are controlled as if they did not couple.
    pub uncouple: bool,
}

impl Site {
    /// A site at the world's origin, at rest.
    pub const ORIGIN: Self = Self { position: [0.0; 3], rotation: IDENTITY, velocity: [0.0; 6] };
}

impl ArmState {
    /// An arm of `joints` joints, all zero.
    ///
    /// # Errors
    /// [`Error::Value`] if there are no joints or more than [`MAX_JOINTS`].
    pub fn new(joints: usize) -> Result<Self> {
        if joints == 0 || joints > MAX_JOINTS {
            return Err(Error::Value { what: "joints", found: joints.to_string(), expected: "between 1 and 8" });
        }
        Ok(Self {
            joints,
            eef: Site::ORIGIN,
            position: [0.0; MAX_JOINTS],
            velocity: [0.0; MAX_JOINTS],
            jacobian: [[0.0; MAX_JOINTS]; 6],
            inertia: [[0.0; MAX_JOINTS]; MAX_JOINTS],
        })
    }
}

/// The goal that lies `delta` away from the end effector: a translation in metres, then axis times angle in radians.
#[must_use]
pub fn goal(eef: &Site, base: &Site, frame: ActionFrame, delta: &[f64; 6]) -> Goal {
    let (position, rotation) = match frame {
        ActionFrame::World => (eef.position, eef.rotation),
        ActionFrame::Base => {
            let inverse = transpose(&base.rotation);
            (rotate(&inverse, &subtract(&eef.position, &base.position)), multiply(&inverse, &eef.rotation))
        }
    };
    Goal {
        position: std::array::from_fn(|i| position[i] + delta[i]),
        rotation: multiply(&goal_rotation(&[delta[3], delta[4], delta[5]]), &rotation),
    }
}

/// The torques (N m) that pull the arm toward `goal` and, in the null space, toward `posture` (rad). They do not compensate
/// gravity and Coriolis forces: add the simulator's bias.
#[must_use]
pub fn torques(
    arm: &ArmState,
    base: &Site,
    frame: ActionFrame,
    goal: &Goal,
    gains: &Gains,
    posture: &Joints,
) -> Joints {
    let n = arm.joints;
    let (position, rotation) = match frame {
        ActionFrame::World => (goal.position, goal.rotation),
        ActionFrame::Base => {
            let offset = rotate(&base.rotation, &goal.position);
            (add(&base.position, &offset), multiply(&base.rotation, &goal.rotation))
        }
    };
    let translation = subtract(&position, &arm.eef.position);
    let turn = orientation_error(&rotation, &arm.eef.rotation);
    let acceleration: [f64; 6] = std::array::from_fn(|i| {
        let error = if i < 3 { translation[i] } else { turn[i - 3] };
        error * gains.stiffness[i] - (arm.eef.velocity[i] - base.velocity[i]) * gains.damping[i]
    });

    let mobility = mobility(arm);
    let inertia = symmetric_inverse(&mobility);
    let wrench = if gains.uncouple {
        let force =
            apply(&symmetric_inverse(&block(&mobility, 0)), &[acceleration[0], acceleration[1], acceleration[2]]);
        let moment =
            apply(&symmetric_inverse(&block(&mobility, 3)), &[acceleration[3], acceleration[4], acceleration[5]]);
        [force[0], force[1], force[2], moment[0], moment[1], moment[2]]
    } else {
        apply(&inertia, &acceleration)
    };

    // The posture's acceleration, without the part that would move the end effector.
    let damping = 2.0 * POSTURE_STIFFNESS.sqrt();
    let mut relax = [0.0; MAX_JOINTS];
    for j in 0..n {
        relax[j] = POSTURE_STIFFNESS * (posture[j] - arm.position[j]) - damping * arm.velocity[j];
    }
    let moved: [f64; 6] = std::array::from_fn(|i| (0..n).map(|j| arm.jacobian[i][j] * relax[j]).sum());
    let held = apply(&inertia, &moved);
    let mut torques = [0.0; MAX_JOINTS];
    for (j, torque) in torques.iter_mut().enumerate().take(n) {
        let task: f64 = (0..6).map(|i| arm.jacobian[i][j] * (wrench[i] - held[i])).sum();
        *torque = task + (0..n).map(|k| arm.inertia[j][k] * relax[k]).sum::<f64>();
    }
    torques
}

/// The rotation about `vector` by its length (radians), rounded as robosuite rounds it: the quaternion and its products
/// are in single precision, the sums on the diagonal in double precision.
#[must_use]
pub fn goal_rotation(vector: &Vector3) -> Matrix3 {
    let angle = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
    if angle == 0.0 {
        return IDENTITY;
    }
    let (sin, cos) = (angle / 2.0).sin_cos();
    let exact = [cos, vector[0] / angle * sin, vector[1] / angle * sin, vector[2] / angle * sin];
    let quat_wxyz = exact.map(|x| x as f32);
    // As OpenBLAS's dot product of four numbers: single-precision products, summed in double precision.
    let norm = quat_wxyz.iter().map(|x| f64::from(x * x)).sum::<f64>() as f32;
    let scale = (2.0 / f64::from(norm)).sqrt();
    let scaled = quat_wxyz.map(|x| (f64::from(x) * scale) as f32);
    let q = |i: usize, j: usize| scaled[i] * scaled[j];
    let diagonal = |i: usize, j: usize| 1.0 - f64::from(q(i, i)) - f64::from(q(j, j));
    [
        [diagonal(2, 3), f64::from(q(1, 2) - q(3, 0)), f64::from(q(1, 3) + q(2, 0))],
        [f64::from(q(1, 2) + q(3, 0)), diagonal(1, 3), f64::from(q(2, 3) - q(1, 0))],
        [f64::from(q(1, 3) - q(2, 0)), f64::from(q(2, 3) + q(1, 0)), diagonal(1, 2)],
    ]
}

/// Half the sum of the cross products of `current`'s axes with `desired`'s: for small angles, the rotation vector.
#[must_use]
pub fn orientation_error(desired: &Matrix3, current: &Matrix3) -> Vector3 {
    let axes = transpose(current).into_iter().zip(transpose(desired));
    scale(&axes.fold([0.0; 3], |sum, (current, desired)| add(&sum, &cross(&current, &desired))), 0.5)
}

/// `J M^-1 J^T`: the end effector's acceleration per unit wrench.
fn mobility(arm: &ArmState) -> [[f64; 6]; 6] {
    let n = arm.joints;
    let mut result = [[0.0; 6]; 6];
    if let Some(factor) = cholesky(&arm.inertia, n) {
        // With M = L L^T and X = L^-1 J^T this is X^T X.
        let columns: [Joints; 6] = std::array::from_fn(|i| forward(&factor, &arm.jacobian[i], n));
        for i in 0..6 {
            for j in 0..=i {
                result[i][j] = (0..n).map(|k| columns[i][k] * columns[j][k]).sum();
                result[j][i] = result[i][j];
            }
        }
    }
    result
}

/// The Moore-Penrose inverse of a symmetric matrix that is positive semi-definite up to rounding. Eigenvalues below 1e-15
/// of the largest count as zero, as in NumPy's `pinv`.
#[must_use]
pub fn symmetric_inverse<const N: usize>(matrix: &[[f64; N]; N]) -> [[f64; N]; N] {
    definite_inverse(matrix).unwrap_or_else(|| pseudo_inverse(matrix))
}

/// The inverse of a matrix that is far enough from singular for its inverse to equal the pseudo-inverse.
fn definite_inverse<const N: usize>(matrix: &[[f64; N]; N]) -> Option<[[f64; N]; N]> {
    const SINGULAR: f64 = 1e-10;
    let factor = cholesky(matrix, N)?;
    let (mut low, mut high) = (f64::INFINITY, 0.0_f64);
    for (i, row) in factor.iter().enumerate() {
        low = low.min(row[i]);
        high = high.max(row[i]);
    }
    if low * low <= SINGULAR * high * high {
        return None;
    }
    let columns: [[f64; N]; N] = std::array::from_fn(|i| {
        let mut unit = [0.0; N];
        unit[i] = 1.0;
        backward(&factor, &forward(&factor, &unit, N), N)
    });
    Some(std::array::from_fn(|i| std::array::from_fn(|j| 0.5 * (columns[i][j] + columns[j][i]))))
}

/// The pseudo-inverse through the eigenvectors. All NaN if they cannot be found, which happens only if the matrix is not
/// finite.
fn pseudo_inverse<const N: usize>(matrix: &[[f64; N]; N]) -> [[f64; N]; N] {
    const CUTOFF: f64 = 1e-15;
    let Ok(eigen) = Mat::from_fn(N, N, |i, j| matrix[i][j]).self_adjoint_eigen(Side::Lower) else {
        return [[f64::NAN; N]; N];
    };
    let (values, vectors) = (eigen.S(), eigen.U());
    let largest = (0..N).map(|k| values[k].abs()).fold(0.0, f64::max);
    let inverse: [f64; N] =
        std::array::from_fn(|k| if values[k].abs() > CUTOFF * largest { 1.0 / values[k] } else { 0.0 });
    std::array::from_fn(|i| {
        std::array::from_fn(|j| (0..N).map(|k| vectors[(i, k)] * inverse[k] * vectors[(j, k)]).sum())
    })
}

/// The lower factor of the leading `n` x `n` block, or `None` if it is not positive definite.
fn cholesky<const N: usize>(matrix: &[[f64; N]; N], n: usize) -> Option<[[f64; N]; N]> {
    let mut factor = [[0.0; N]; N];
    for i in 0..n {
        for j in 0..=i {
            let rest = matrix[i][j] - (0..j).map(|k| factor[i][k] * factor[j][k]).sum::<f64>();
            if i != j {
                factor[i][j] = rest / factor[j][j];
            } else if rest > 0.0 {
                factor[i][i] = rest.sqrt();
            } else {
                return None;
            }
        }
    }
    Some(factor)
}

fn forward<const N: usize>(factor: &[[f64; N]; N], right: &[f64; N], n: usize) -> [f64; N] {
    let mut x = [0.0; N];
    for i in 0..n {
        x[i] = (right[i] - (0..i).map(|k| factor[i][k] * x[k]).sum::<f64>()) / factor[i][i];
    }
    x
}

fn backward<const N: usize>(factor: &[[f64; N]; N], right: &[f64; N], n: usize) -> [f64; N] {
    let mut x = [0.0; N];
    for i in (0..n).rev() {
        x[i] = (right[i] - (i + 1..n).map(|k| factor[k][i] * x[k]).sum::<f64>()) / factor[i][i];
    }
    x
}

fn apply<const N: usize>(matrix: &[[f64; N]; N], vector: &[f64; N]) -> [f64; N] {
    std::array::from_fn(|i| (0..N).map(|k| matrix[i][k] * vector[k]).sum())
}

/// The 3 x 3 block on the diagonal that starts at `start`.
fn block(matrix: &[[f64; 6]; 6], start: usize) -> Matrix3 {
    std::array::from_fn(|i| std::array::from_fn(|j| matrix[start + i][start + j]))
}
