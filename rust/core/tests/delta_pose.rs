//! The law stays within its limits, and the gate moves only when the object does.

use ocplanner_core::delta_pose::{DeltaPoseController, DeltaPoseLaw, Follow, checked_pose};
use ocplanner_core::error::Error;
use ocplanner_core::pose::{IDENTITY, Pose, add, rotate, rotation_exp, subtract};
use proptest::prelude::*;

fn rotations() -> impl Strategy<Value = [[f64; 3]; 3]> {
    prop::array::uniform3(-4.0..4.0_f64).prop_map(|vector| rotation_exp(&vector).unwrap())
}

fn poses() -> impl Strategy<Value = Pose> {
    (prop::array::uniform3(-2.0..2.0_f64), rotations())
        .prop_map(|(position, rotation)| checked_pose("pose", position, rotation).unwrap())
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
        let target = Pose::compose(&Pose { position: [0.0; 3], rotation: spin }, &object);
        let target = Pose { position: object.position, ..target };
        let action = law.action(&object, &target, &eef, &IDENTITY).unwrap();
        let moved: [f64; 3] = std::array::from_fn(|i| eef.position[i] + action[i] * 1e3);
        let carried = add(&object.position, &rotate(&spin, &subtract(&eef.position, &object.position)));
        for i in 0..3 {
            prop_assert!((moved[i] - carried[i]).abs() < 1e-9);
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
    let mut controller = DeltaPoseController::new(DeltaPoseLaw::default(), gate).unwrap();
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
    let mut controller = DeltaPoseController::new(DeltaPoseLaw::default(), Follow::Time).unwrap();
    controller.set_plan(line(), None, &at(0.0)).unwrap();
    let seen: Vec<f64> = (0..25).map(|_| controller.target(&at(0.0)).unwrap().position[0]).collect();
    assert!((seen[0] - 0.02).abs() < 1e-12 && (seen[19] - 0.4).abs() < 1e-12 && seen[24] == seen[19]);
    assert!(controller.at_end());
}

#[test]
fn open_loop_is_blind_to_the_object() {
    let mut controller = DeltaPoseController::new(DeltaPoseLaw::default(), Follow::OpenLoop).unwrap();
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
    let nan = checked_pose("object", [f64::NAN, 0.0, 0.0], IDENTITY);
    assert!(matches!(nan, Err(Error::Value { what: "object", .. })));
    let scaled = [[2.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mirrored = [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    for bad in [scaled, mirrored, [[f64::NAN; 3]; 3]] {
        assert!(checked_pose("object", [0.0; 3], bad).is_err());
    }
    let law = DeltaPoseLaw { gain_position: -1.0, ..DeltaPoseLaw::default() };
    assert!(law.validate().is_err());
    let law = DeltaPoseLaw { limit_rotation: 0.6, ..DeltaPoseLaw::default() };
    assert!(law.validate().is_err());
    let mut controller = DeltaPoseController::new(DeltaPoseLaw::default(), Follow::Time).unwrap();
    assert!(controller.target(&at(0.0)).is_err(), "no plan yet");
    assert!(controller.set_plan(Vec::new(), None, &at(0.0)).is_err());
    assert!(controller.set_plan(line(), Some(vec![IDENTITY; 3]), &at(0.0)).is_err());
}
