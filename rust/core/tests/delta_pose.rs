//! The law stays within its limits, and the gate moves only when the object does.

use ocplanner_core::delta_pose::{DeltaPoseController, DeltaPoseLaw, Follow};
use ocplanner_core::error::Error;
use ocplanner_core::pose::{
    IDENTITY, Matrix3, Pose, add, multiply, quat_xyzw_from_rotation, rotate, rotation_exp, rotation_from_quat_xyzw,
    scale, subtract, transpose,
};
use proptest::prelude::*;
use std::f64::consts::{PI, TAU};

fn rotations() -> impl Strategy<Value = [[f64; 3]; 3]> {
    prop::array::uniform3(-4.0..4.0_f64).prop_map(|vector| rotation_exp(&vector).unwrap())
}

fn poses() -> impl Strategy<Value = Pose> {
    (prop::array::uniform3(-2.0..2.0_f64), rotations())
        .prop_map(|(position, rotation)| Pose::checked("pose", position, rotation).unwrap())
}

fn length(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

proptest! {
    #[test]
    fn actions_stay_within_the_limits(
        object in poses(), target in poses(), eef in poses(), base in rotations(),
        gain in 0.1..10.0_f64, horizontal in 0.001..0.05_f64, vertical in 0.001..0.05_f64, turn in 0.01..0.5_f64,
    ) {
        let law = DeltaPoseLaw {
            gain_position: gain, gain_rotation: gain, limit_horizontal: horizontal, limit_vertical: vertical,
            limit_rotation: turn, ..DeltaPoseLaw::default()
        };
        let action = law.validate().unwrap().action(&object, &target, &eef, &base).unwrap();
        prop_assert!(action.iter().all(|x| x.is_finite() && x.abs() <= 1.0));
        prop_assert!(length(&action[..2]) * 0.05 <= horizontal + 1e-12);
        prop_assert!(action[2].abs() * 0.05 <= vertical + 1e-12);
        prop_assert!(length(&action[3..]) * 0.5 <= turn + 1e-12);
    }

    #[test]
    fn nothing_moves_when_the_object_is_there(object in poses(), eef in poses(), base in rotations()) {
        let action = DeltaPoseLaw::default().action(&object, &object, &eef, &base).unwrap();
        prop_assert!(length(&action) < 1e-6);
    }

    #[test]
    fn turning_in_place_keeps_the_object_where_it_is(object in poses(), eef in poses(), turn in -0.1..0.1_f64) {
        // applying the unclipped command to the end effector turns the rigidly held object about its own origin
        let law = DeltaPoseLaw { limit_horizontal: 1e3, limit_vertical: 1e3, limit_rotation: 3.0, scale_position: 1e3,
            scale_rotation: 3.0, ..DeltaPoseLaw::default() };
        let spin = rotation_exp(&[0.0, 0.0, turn]).unwrap();
        let target = Pose { position: object.position, rotation: multiply(&spin, &object.rotation) };
        let action = law.action(&object, &target, &eef, &IDENTITY).unwrap();
        let moved: [f64; 3] = std::array::from_fn(|i| eef.position[i] + action[i] * 1e3);
        let carried = add(&object.position, &rotate(&spin, &subtract(&eef.position, &object.position)));
        for i in 0..3 {
            prop_assert!((moved[i] - carried[i]).abs() < 1e-9);
        }
    }
}

fn unit_vectors() -> impl Strategy<Value = [f64; 3]> {
    prop::array::uniform3(-1.0..1.0_f64)
        .prop_filter("not near zero", |v| length(v) > 0.1)
        .prop_map(|v| scale(&v, 1.0 / length(&v)))
}

/// The rotation command from one rotation to another, radians, unclipped.
fn turn_command(from: Matrix3, to: Matrix3) -> [f64; 3] {
    let law = DeltaPoseLaw { limit_rotation: 4.0, scale_rotation: 4.0, ..DeltaPoseLaw::default() };
    let pose = |rotation| Pose { position: [0.0; 3], rotation };
    let action = law.action(&pose(from), &pose(to), &pose(from), &IDENTITY).unwrap();
    std::array::from_fn(|i| action[3 + i] * 4.0)
}

proptest! {
    #[test]
    fn the_default_limits_are_five_centimetres_and_a_fifth_of_a_radian(
        object in poses(), target in poses(), eef in poses(), base in rotations(), gain in 0.1..1e6_f64,
    ) {
        let law = DeltaPoseLaw { gain_position: gain, gain_rotation: gain, ..DeltaPoseLaw::default() };
        let action = law.action(&object, &target, &eef, &base).unwrap();
        prop_assert!(length(&action[..2]) * 0.05 <= 0.05 + 1e-12);
        prop_assert!(action[2].abs() * 0.05 <= 0.05 + 1e-12);
        prop_assert!(length(&action[3..]) * 0.5 <= 0.2 + 1e-12);
    }

    #[test]
    fn any_finite_position_gives_an_action_within_limits_or_an_error(
        positions in prop::array::uniform3(prop::array::uniform3(prop::num::f64::NORMAL)), gain in 0.1..1e300_f64,
    ) {
        let law = DeltaPoseLaw { gain_position: gain, gain_rotation: gain, ..DeltaPoseLaw::default() };
        let [object, target, eef] = positions.map(|position| Pose { position, rotation: IDENTITY });
        if let Ok(action) = law.action(&object, &target, &eef, &IDENTITY) {
            prop_assert!(action.iter().all(|x| x.abs() <= 1.0), "{action:?}");
        }
    }

    #[test]
    fn clipping_keeps_directions_and_what_is_within_limits(
        delta in prop::array::uniform3(-0.5..0.5_f64), axis in unit_vectors(), angle in 0.0..3.0_f64,
    ) {
        let target = Pose { position: delta, rotation: rotation_exp(&scale(&axis, angle)).unwrap() };
        let here = Pose { position: [0.0; 3], rotation: IDENTITY };
        let action = DeltaPoseLaw::default().action(&here, &target, &here, &IDENTITY).unwrap();
        let shorter = |length: f64, limit: f64| if length > limit { limit / length } else { 1.0 };
        let (flat, turn) = (shorter(delta[0].hypot(delta[1]), 0.05), angle.min(0.2));
        for i in 0..2 {
            prop_assert!((action[i] * 0.05 - flat * delta[i]).abs() < 1e-12);
        }
        // However far the target is sideways, the lift is not starved, and the other way round.
        prop_assert!((action[2] * 0.05 - delta[2].clamp(-0.05, 0.05)).abs() < 1e-12);
        for i in 0..3 {
            prop_assert!((action[3 + i] * 0.5 - turn * axis[i]).abs() < 1e-9);
        }
    }

    #[test]
    fn the_sign_of_a_quaternion_does_not_matter(
        from in rotations(), to in rotations(), object_sign: bool, target_sign: bool,
    ) {
        let signed = |rotation: &Matrix3, flip: bool| {
            let quat = quat_xyzw_from_rotation(rotation).unwrap();
            rotation_from_quat_xyzw(&quat.map(|x| if flip { -x } else { x })).unwrap()
        };
        let turn = multiply(&to, &transpose(&from));
        // Near a half turn the two ways round are equally short.
        prop_assume!(turn[0][0] + turn[1][1] + turn[2][2] > -0.99);
        let expected = turn_command(from, to);
        let found = turn_command(signed(&from, object_sign), signed(&to, target_sign));
        for i in 0..3 {
            prop_assert!((found[i] - expected[i]).abs() < 1e-9);
        }
    }

    #[test]
    fn turns_go_the_short_way_round(from in rotations(), axis in unit_vectors(), angle in -20.0..20.0_f64) {
        let wrapped = angle - TAU * (angle / TAU).round();
        prop_assume!(wrapped.abs() < PI - 1e-3);
        let to = multiply(&rotation_exp(&scale(&axis, angle)).unwrap(), &from);
        let found = turn_command(from, to);
        for i in 0..3 {
            prop_assert!((found[i] - wrapped * axis[i]).abs() < 1e-9, "{found:?} for {wrapped} about {axis:?}");
        }
    }

    #[test]
    fn a_half_turn_is_a_turn_either_way(from in rotations(), axis in unit_vectors(), off in -1e-9..1e-9_f64) {
        let to = multiply(&rotation_exp(&scale(&axis, PI + off)).unwrap(), &from);
        let found = turn_command(from, to);
        prop_assert!((length(&found) - PI).abs() < 1e-6);
        let along: f64 = found.iter().zip(&axis).map(|(f, a)| f * a).sum();
        prop_assert!((along.abs() - PI).abs() < 1e-6);
    }

    #[test]
    fn the_command_is_in_the_base_frame(
        object in poses(), target in poses(), eef in poses(), base in rotations(), origin in prop::array::uniform3(-2.0..2.0_f64),
    ) {
        // Moving and turning the whole world, base included, changes nothing.
        let law = DeltaPoseLaw::default();
        let world = |pose: &Pose| Pose {
            position: add(&origin, &rotate(&base, &pose.position)),
            rotation: multiply(&base, &pose.rotation),
        };
        let expected = law.action(&object, &target, &eef, &IDENTITY).unwrap();
        let moved = [&object, &target, &eef].map(world);
        let turn = multiply(&target.rotation, &transpose(&object.rotation));
        prop_assume!(turn[0][0] + turn[1][1] + turn[2][2] > -0.99);
        let found = law.action(&moved[0], &moved[1], &moved[2], &base).unwrap();
        for i in 0..6 {
            prop_assert!((found[i] - expected[i]).abs() < 1e-9);
        }
    }

    #[test]
    fn a_controller_stays_within_the_plan_and_the_limits(
        plan in prop::collection::vec(poses(), 1..8), seen in prop::collection::vec((poses(), poses()), 1..12),
        base in rotations(), which in 0..3_usize, with_rotation: bool,
    ) {
        let follow = [Follow::OpenLoop, Follow::Time, Follow::Gated { position: 1.0, rotation: 1.0 }][which];
        let mut controller = DeltaPoseController::new(follow).unwrap();
        let rotations = with_rotation.then(|| plan.iter().map(|pose| pose.rotation).collect());
        controller.set_plan(plan.iter().map(|pose| pose.position).collect(), rotations, &seen[0].0).unwrap();
        let mut index = controller.index();
        for (object, eef) in &seen {
            let target = controller.target(object).unwrap();
            prop_assert!(controller.index() >= index && controller.index() < plan.len(), "never back, never beyond");
            index = controller.index();
            let action = DeltaPoseLaw::default().action(object, &target, eef, &base).unwrap();
            prop_assert!(action.iter().all(|x| x.abs() <= 1.0));
            prop_assert!(length(&action[..2]) <= 1.0 + 1e-12 && length(&action[3..]) <= 0.4 + 1e-12);
        }
    }
}

fn at(x: f64) -> Pose {
    Pose { position: [x, 0.0, 1.0], rotation: IDENTITY }
}

fn line() -> Vec<[f64; 3]> {
    (1..=20).map(|i| [0.02 * f64::from(i), 0.0, 1.0]).collect()
}

#[test]
fn the_gate_waits_for_the_object() {
    let gate = Follow::Gated { position: 0.025, rotation: 0.2 };
    let mut controller = DeltaPoseController::new(gate).unwrap();
    controller.set_plan(line(), Some(vec![IDENTITY; 20]), &at(0.1)).unwrap();
    assert_eq!(controller.index(), 4);
    let target = controller.target(&at(0.1)).unwrap();
    assert!((target.position[0] - 0.14).abs() < 1e-12);
    for _ in 0..5 {
        assert_eq!(controller.target(&at(0.1)).unwrap(), target);
    }
    assert!(controller.target(&at(0.13)).unwrap().position[0] > 0.14);
    let mut turned = at(0.4);
    turned.rotation = rotation_exp(&[0.0, 0.0, 0.5]).unwrap();
    let index = controller.index();
    controller.target(&turned).unwrap();
    assert_eq!(controller.index(), index, "a turned object does not pass the gate");
}

#[test]
fn time_advances_whatever_the_object_does() {
    let mut controller = DeltaPoseController::new(Follow::Time).unwrap();
    controller.set_plan(line(), None, &at(0.0)).unwrap();
    let seen: Vec<f64> = (0..25).map(|_| controller.target(&at(0.0)).unwrap().position[0]).collect();
    assert!((seen[0] - 0.02).abs() < 1e-12 && (seen[19] - 0.4).abs() < 1e-12 && seen[24] == seen[19]);
    assert!(controller.at_end());
}

#[test]
fn open_loop_is_blind_to_the_object() {
    let mut controller = DeltaPoseController::new(Follow::OpenLoop).unwrap();
    controller.set_plan(line(), Some(vec![IDENTITY; 20]), &at(0.0)).unwrap();
    for step in 0..25 {
        let object = at(f64::from(step) * 0.3);
        let delta = controller.target(&object).unwrap().position[0] - object.position[0];
        let expected = if step < 19 { 0.02 } else { 0.0 };
        assert!((delta - expected).abs() < 1e-9);
    }
}

#[test]
fn bad_input_is_an_error() {
    let nan = Pose::checked("object", [f64::NAN, 0.0, 0.0], IDENTITY);
    assert!(matches!(nan, Err(Error::Value { what: "object", .. })));
    let scaled = [[2.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mirrored = [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for bad in [scaled, mirrored, [[f64::NAN; 3]; 3]] {
        assert!(Pose::checked("object", [0.0; 3], bad).is_err());
    }
    let law = DeltaPoseLaw { gain_position: -1.0, ..DeltaPoseLaw::default() };
    assert!(law.validate().is_err());
    let law = DeltaPoseLaw { limit_rotation: 0.6, ..DeltaPoseLaw::default() };
    assert!(law.validate().is_err());
    let mut controller = DeltaPoseController::new(Follow::Time).unwrap();
    assert!(controller.target(&at(0.0)).is_err(), "no plan yet");
    assert!(controller.set_plan(Vec::new(), None, &at(0.0)).is_err());
    assert!(controller.set_plan(line(), Some(vec![IDENTITY; 3]), &at(0.0)).is_err());
}
