//! Rewards are finite, best on the plan, zero without a grasp; shaping telescopes.

use ocplanner_core::error::Error;
use ocplanner_core::pose::{IDENTITY, Matrix3, Vector3, multiply, norm, rotation_exp, scale};
use ocplanner_core::reward::{
    EpisodeEnd::{self, Terminated, Truncated},
    Form, Poses, RewardLaw, Rewards, position_error, rotation_error,
};
use proptest::prelude::*;

const FORMS: [Form; 4] = [Form::Penalty, Form::Literal, Form::Exp { scale: 2.5e-4 }, Form::Potential { gamma: 0.99 }];

#[derive(Debug, Clone)]
struct Trajectory {
    position: Vec<Vector3>,
    rotation: Vec<Matrix3>,
}

impl Trajectory {
    fn poses(&self) -> Poses<'_> {
        Poses { position: &self.position, rotation: Some(&self.rotation) }
    }
}

fn trajectory(steps: usize) -> impl Strategy<Value = Trajectory> {
    let pose = (prop::array::uniform3(-2.0..2.0_f64), prop::array::uniform3(-4.0..4.0_f64));
    prop::collection::vec(pose, steps).prop_map(|poses| Trajectory {
        position: poses.iter().map(|pose| pose.0).collect(),
        rotation: poses.iter().map(|pose| rotation_exp(&pose.1).unwrap()).collect(),
    })
}

fn episode() -> impl Strategy<Value = (Trajectory, Trajectory, Vec<bool>)> {
    (0..30_usize)
        .prop_flat_map(|steps| (trajectory(steps), trajectory(steps), prop::collection::vec(any::<bool>(), steps)))
}

fn ends() -> impl Strategy<Value = EpisodeEnd> {
    prop_oneof![Just(Terminated), Just(Truncated)]
}

fn weights() -> impl Strategy<Value = (f64, f64)> {
    (0.0..10.0_f64, 0.0..10.0_f64)
}

fn rewards(law: RewardLaw, planned: Poses<'_>, achieved: Poses<'_>, grasping: &[bool], end: EpisodeEnd) -> Rewards {
    law.validate().unwrap().rewards(planned, achieved, grasping, &[], end).unwrap()
}

proptest! {
    #[test]
    fn rewards_are_finite_and_zero_without_a_grasp(
        (planned, achieved, grasping) in episode(), (a, b) in weights(), end in ends(),
    ) {
        for form in FORMS {
            let law = RewardLaw { weight_position: a, weight_rotation: b, form };
            let found = rewards(law, planned.poses(), achieved.poses(), &grasping, end);
            let turned = found.rotation.unwrap();
            prop_assert_eq!([found.position.len(), turned.len(), found.reward.len()], [grasping.len(); 3]);
            for (t, &held) in grasping.iter().enumerate() {
                let (position, rotation, reward) = (found.position[t], turned[t], found.reward[t]);
                prop_assert!(reward.is_finite() && position >= 0.0 && (0.0..=8.0 + 1e-9).contains(&rotation));
                match form {
                    _ if !held && !matches!(form, Form::Potential { .. }) => {
                        prop_assert_eq!([position, rotation, reward], [0.0; 3]);
                    }
                    Form::Penalty => prop_assert!(reward <= 0.0),
                    Form::Literal => prop_assert!(reward >= 0.0),
                    Form::Exp { .. } => prop_assert!((0.0..=1.0).contains(&reward)),
                    Form::Potential { .. } => {}
                }
            }
        }
    }

    #[test]
    fn the_plan_itself_is_best((_, on_plan, grasping) in episode(), (a, b) in weights(), end in ends()) {
        for form in FORMS {
            let law = RewardLaw { weight_position: a, weight_rotation: b, form };
            let found = rewards(law, on_plan.poses(), on_plan.poses(), &grasping, end);
            for (&reward, &held) in found.reward.iter().zip(&grasping) {
                let best = f64::from(u8::from(held && matches!(form, Form::Exp { .. })));
                prop_assert_eq!(reward, best);
                prop_assert!(reward.is_sign_positive(), "no negative zero");
            }
        }
    }

    #[test]
    fn penalty_is_the_negative_of_the_printed_equation(
        (planned, achieved, grasping) in episode(), (a, b) in weights(),
    ) {
        let law = |form| RewardLaw { weight_position: a, weight_rotation: b, form };
        let printed = rewards(law(Form::Literal), planned.poses(), achieved.poses(), &grasping, Terminated);
        let penalty = rewards(law(Form::Penalty), planned.poses(), achieved.poses(), &grasping, Terminated);
        let turned = printed.rotation.unwrap();
        for (t, turned) in turned.iter().enumerate() {
            let sum = a * printed.position[t] + b * turned;
            prop_assert!((printed.reward[t] - sum).abs() <= 1e-12 * sum);
            prop_assert_eq!(penalty.reward[t], 0.0 - printed.reward[t]);
        }
    }

    #[test]
    fn exp_falls_to_one_over_e_at_the_scale(x in 0.001..2.0_f64, a in 0.001..10.0_f64) {
        let law = RewardLaw { weight_position: a, weight_rotation: 0.0, form: Form::Exp { scale: a * x * x } };
        let here = Poses { position: &[[0.0; 3]], rotation: None };
        let away = Poses { position: &[[0.0, x, 0.0]], rotation: None };
        prop_assert!((rewards(law, here, away, &[true], Terminated).reward[0] - (-1.0_f64).exp()).abs() < 1e-12);
    }

    #[test]
    fn shaping_telescopes((planned, achieved, grasping) in episode(), (a, b) in weights(), gamma in 0.0..=1.0_f64) {
        let law = RewardLaw { weight_position: a, weight_rotation: b, form: Form::Potential { gamma } };
        let penalty = RewardLaw { form: Form::Penalty, ..law };
        let errors = rewards(penalty, planned.poses(), achieved.poses(), &grasping, Truncated).reward;
        let discounted = |rewards: &[f64]| rewards.iter().rev().fold(0.0, |sum, reward| reward + gamma * sum);
        let size = 1e-11 * (1.0 + errors.iter().map(|error| error.abs()).sum::<f64>());
        let ended = rewards(law, planned.poses(), achieved.poses(), &grasping, Terminated).reward;
        prop_assert!(discounted(&ended).abs() < size);
        let cut = rewards(law, planned.poses(), achieved.poses(), &grasping, Truncated).reward;
        let last = errors.last().map_or(0.0, |phi| gamma.powi(i32::try_from(errors.len()).unwrap()) * phi);
        prop_assert!((discounted(&cut) - last).abs() < size, "{} is not {last}", discounted(&cut));
    }

    #[test]
    fn the_rotation_term_follows_the_angle(
        base in prop::array::uniform3(-4.0..4.0_f64), axis in prop::array::uniform3(-1.0..1.0_f64), angle in -3.2..3.2_f64,
    ) {
        prop_assume!(norm(&axis) > 1e-3);
        let axis = scale(&axis, 1.0 / norm(&axis));
        let from = rotation_exp(&base).unwrap();
        let to = multiply(&from, &rotation_exp(&scale(&axis, angle)).unwrap());
        let expected = 2.0 * (1.0 - angle.cos()) * (1.0 + axis[2] * axis[2]);
        prop_assert!((rotation_error(&from, &to).unwrap() - expected).abs() < 1e-12);
        prop_assert!((rotation_error(&to, &from).unwrap() - expected).abs() < 1e-12);
    }

    #[test]
    fn any_number_gives_a_finite_reward_or_an_error(
        planned in prop::array::uniform3(any::<f64>()), achieved in prop::array::uniform3(any::<f64>()),
        a in any::<f64>(), parameter in any::<f64>(), which in 0..4_usize,
    ) {
        let form = match FORMS[which] {
            Form::Exp { .. } => Form::Exp { scale: parameter },
            Form::Potential { .. } => Form::Potential { gamma: parameter },
            other => other,
        };
        let law = RewardLaw { weight_position: a, weight_rotation: 1.0, form };
        let Ok(law) = law.validate() else { return Ok(()) };
        let (planned, achieved) = ([planned], [achieved]);
        let poses = |position| Poses { position, rotation: None };
        if let Ok(found) = law.rewards(poses(&planned), poses(&achieved), &[true], &[], Truncated) {
            prop_assert!(found.reward[0].is_finite() && found.position[0].is_finite());
        }
    }
}

#[test]
fn shaping_pays_back_when_the_grasp_ends() {
    let x = |positions: &[f64]| positions.iter().map(|&x| [x, 0.0, 0.0]).collect::<Vec<_>>();
    let (planned, achieved) = (x(&[0.0; 5]), x(&[9.0, 1.0, 2.0, 9.0, 9.0]));
    let grasping = [false, true, true, false, false];
    let law = RewardLaw { weight_position: 1.0, form: Form::Potential { gamma: 0.5 }, ..RewardLaw::default() };
    let poses = |position| Poses { position, rotation: None };
    let found = rewards(law, poses(&planned), poses(&achieved), &grasping, Terminated);
    assert_eq!(found.position, [0.0, 1.0, 4.0, 0.0, 0.0]);
    assert_eq!(found.reward, [0.0, -0.5, 1.0 - 0.5 * 4.0, 4.0, 0.0]);
    // A grasp that lasts to the end: a terminal state has no potential, a truncated episode keeps it.
    let held = |end| rewards(law, poses(&planned[..3]), poses(&achieved[..3]), &grasping[..3], end).reward;
    assert_eq!(held(Terminated), [0.0, -0.5, 1.0]);
    assert_eq!(held(Truncated), [0.0, -0.5, -1.0]);
}

#[test]
fn a_plan_of_positions_has_no_rotation_term() {
    let turned = rotation_exp(&[0.0, 0.0, 1.0]).unwrap();
    let planned = Poses { position: &[[0.0; 3]], rotation: None };
    let achieved = Poses { position: &[[0.1, 0.0, 0.0]], rotation: Some(&[turned]) };
    let found = rewards(RewardLaw::default(), planned, achieved, &[true], Terminated);
    assert!(found.rotation.is_none());
    assert!((found.reward[0] + 0.003 * 0.01).abs() < 1e-15);
}

#[test]
fn bad_input_is_an_error() {
    let run = |law: RewardLaw, planned: Poses<'_>, achieved: Poses<'_>, grasping: &[bool]| {
        law.rewards(planned, achieved, grasping, &[], Terminated).unwrap_err()
    };
    let (law, origin) = (RewardLaw::default(), [[0.0; 3]]);
    let good = Poses { position: &origin, rotation: Some(&[IDENTITY]) };
    for number in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let broken = [[0.0, number, 0.0]];
        let bad = Poses { position: &broken, ..good };
        // Without a grasp too: what is not counted may not be nonsense either.
        for grasping in [[true], [false]] {
            assert!(matches!(run(law, bad, good, &grasping), Error::Value { what: "planned position", .. }));
            assert!(matches!(run(law, good, bad, &grasping), Error::Value { what: "achieved position", .. }));
        }
        let broken = [[[number; 3]; 3]];
        let bad = Poses { rotation: Some(&broken), ..good };
        assert!(matches!(run(law, bad, good, &[true]), Error::Value { what: "planned rotation", .. }));
        assert!(matches!(run(law, good, bad, &[false]), Error::Value { what: "achieved rotation", .. }));
        for form in [Form::Exp { scale: number }, Form::Potential { gamma: number }] {
            assert!(RewardLaw { form, ..law }.validate().is_err());
        }
        assert!(RewardLaw { weight_position: number, ..law }.validate().is_err());
        assert!(RewardLaw { weight_rotation: number, ..law }.validate().is_err());
    }
    for law in [
        RewardLaw { weight_position: -1.0, ..law },
        RewardLaw { weight_rotation: -1.0, ..law },
        RewardLaw { form: Form::Exp { scale: 0.0 }, ..law },
        RewardLaw { form: Form::Potential { gamma: 1.01 }, ..law },
        RewardLaw { form: Form::Potential { gamma: -0.01 }, ..law },
    ] {
        assert!(law.validate().is_err(), "{law:?}");
    }
    assert!(matches!(run(law, good, good, &[true; 2]), Error::Shape { what: "planned position", .. }));
    let longer = Poses { position: &[[0.0; 3]; 2], ..good };
    assert!(matches!(run(law, good, longer, &[true]), Error::Shape { what: "achieved position", .. }));
    let bare = Poses { rotation: None, ..good };
    assert!(matches!(run(law, good, bare, &[true]), Error::Shape { what: "achieved rotation", .. }));
    let wrong = Poses { rotation: Some(&[IDENTITY; 2]), ..good };
    assert!(matches!(run(law, wrong, good, &[true]), Error::Shape { what: "planned rotation", .. }));
    assert!(position_error(&[1e200, 0.0, 0.0], &[0.0; 3]).is_err(), "the square overflows");
    assert!(rotation_error(&[[2.0; 3]; 3], &IDENTITY).is_err());
}
