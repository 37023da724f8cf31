//! Operational-space control: algebraic axioms and limiting cases. Agreement with robosuite is tested from Python.

use ocplanner_core::osc::{
    ActionFrame, ArmState, Gains, Goal, Joints, MAX_JOINTS, Site, goal, goal_rotation, orientation_error,
    symmetric_inverse, torques,
};
use proptest::prelude::*;

const GAINS: Gains = Gains { stiffness: [150.0; 6], damping: [24.5; 6], uncouple: true };

fn product<const N: usize>(a: &[[f64; N]; N], b: &[[f64; N]; N]) -> [[f64; N]; N] {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..N).map(|k| a[i][k] * b[k][j]).sum()))
}

fn transposed<const N: usize>(a: &[[f64; N]; N]) -> [[f64; N]; N] {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

fn distance<const N: usize>(a: &[[f64; N]; N], b: &[[f64; N]; N]) -> f64 {
    a.as_flattened().iter().zip(b.as_flattened()).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
}

/// An arm of seven joints with a regular inertia and Jacobian.
fn arm(numbers: &[f64]) -> ArmState {
    let mut state = ArmState::new(7).unwrap();
    for i in 0..7 {
        for j in 0..=i {
            let value = 0.1 * numbers[(i * 7 + j) % numbers.len()] + if i == j { 2.0 } else { 0.0 };
            (state.inertia[i][j], state.inertia[j][i]) = (value, value);
        }
        for row in 0..6 {
            state.jacobian[row][i] = numbers[(row * 11 + 5 * i) % numbers.len()] + if row == i { 1.5 } else { 0.0 };
        }
    }
    state
}

fn matrices(rank: usize) -> impl Strategy<Value = [[f64; 6]; 6]> {
    prop::array::uniform6(prop::array::uniform6(-1.0..1.0f64)).prop_map(move |root| {
        // A Gram matrix of `rank` vectors.
        std::array::from_fn(|i| std::array::from_fn(|j| (0..rank).map(|k| root[i][k] * root[j][k]).sum()))
    })
}

proptest! {
    #[test]
    fn pseudo_inverse_obeys_penrose(matrix in (1usize..=6).prop_flat_map(matrices)) {
        let inverse = symmetric_inverse(&matrix);
        let scale = inverse.as_flattened().iter().fold(1.0f64, |m, x| m.max(x.abs()));
        // The axioms hold to rounding, which the condition number magnifies.
        prop_assume!(scale < 1e6);
        let again = product(&product(&matrix, &inverse), &matrix);
        prop_assert!(distance(&again, &matrix) < 1e-9 * scale);
        let back = product(&product(&inverse, &matrix), &inverse);
        prop_assert!(distance(&back, &inverse) < 1e-8 * scale * scale);
        let projector = product(&matrix, &inverse);
        prop_assert!(distance(&projector, &transposed(&projector)) < 1e-8 * scale);
    }

    #[test]
    fn goal_rotation_is_single_precision_exact(vector in prop::array::uniform3(-0.5..0.5f64)) {
        let rotation = goal_rotation(&vector);
        let identity = Site::ORIGIN.rotation;
        prop_assert!(distance(&product(&rotation, &transposed(&rotation)), &identity) < 1e-6);
        // The sine of the angle about the axis, to third order.
        let angle = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
        prop_assume!(angle > 1e-3);
        let error = orientation_error(&rotation, &identity);
        for axis in 0..3 {
            prop_assert!((error[axis] - vector[axis] / angle * angle.sin()).abs() < 1e-6);
        }
    }

    #[test]
    fn goal_does_not_depend_on_the_frame_where_the_base_is_the_world(
        position in prop::array::uniform3(-1.0..1.0f64),
        turn in prop::array::uniform3(-1.0..1.0f64),
        delta in prop::array::uniform6(-0.1..0.1f64),
    ) {
        let eef = Site { position, rotation: goal_rotation(&turn), velocity: [0.0; 6] };
        let a = goal(&eef, &Site::ORIGIN, ActionFrame::Base, &delta);
        let b = goal(&eef, &Site::ORIGIN, ActionFrame::World, &delta);
        prop_assert_eq!(a, b);
    }

    #[test]
    fn posture_torques_do_not_move_the_end_effector(numbers in prop::collection::vec(-0.3..0.3f64, 40..60)) {
        let mut state = arm(&numbers);
        state.position[..7].copy_from_slice(&numbers[..7]);
        let rest = Goal { position: state.eef.position, rotation: state.eef.rotation };
        let torques = torques(&state, &Site::ORIGIN, ActionFrame::World, &rest, &GAINS, &[0.0; MAX_JOINTS]);
        let inverse = symmetric_inverse(&std::array::from_fn::<[f64; 7], 7, _>(|i| {
            std::array::from_fn(|j| state.inertia[i][j])
        }));
        for row in state.jacobian {
            let moved: f64 = (0..7).map(|i| (0..7).map(|j| row[i] * inverse[i][j] * torques[j]).sum::<f64>()).sum();
            prop_assert!(moved.abs() < 1e-8, "{moved}");
        }
    }
}

#[test]
fn an_arm_at_its_goal_and_posture_needs_no_torque() {
    let state = arm(&[0.1, -0.2, 0.3]);
    let rest = Goal { position: state.eef.position, rotation: state.eef.rotation };
    let torques = torques(&state, &Site::ORIGIN, ActionFrame::Base, &rest, &GAINS, &[0.0; MAX_JOINTS]);
    assert_eq!(torques, [0.0; MAX_JOINTS]);
}

#[test]
fn without_a_jacobian_only_the_posture_pulls() {
    let mut state = ArmState::new(2).unwrap();
    state.inertia[0][0] = 1.0;
    state.inertia[1][1] = 2.0;
    let mut posture: Joints = [0.0; MAX_JOINTS];
    posture[..2].copy_from_slice(&[0.5, -0.5]);
    let far = Goal { position: [1.0; 3], rotation: Site::ORIGIN.rotation };
    let torques = torques(&state, &Site::ORIGIN, ActionFrame::World, &far, &GAINS, &posture);
    assert_eq!(torques[..2], [5.0, -10.0]);
}

#[test]
fn an_arm_has_one_to_eight_joints() {
    assert!(ArmState::new(0).is_err());
    assert!(ArmState::new(8).is_ok());
    assert!(ArmState::new(9).is_err());
}
