//! Many environments behave as each of them alone would.

use ocplanner_core::delta_pose::{DeltaPoseController, DeltaPoseLaw, Follow};
use ocplanner_core::delta_pose_batch::{DeltaPoseBatch, PlanBatch, actions};
use ocplanner_core::error::Error;
use ocplanner_core::pose::{IDENTITY, Matrix3, Pose, Vector3, rotation_exp};
use proptest::prelude::*;

const HORIZON: usize = 6;
const ORIGIN: Pose = Pose { position: [0.0; 3], rotation: IDENTITY };

fn poses(count: usize, reach: f64) -> impl Strategy<Value = Vec<Pose>> {
    let pose = (prop::array::uniform3(-reach..reach), prop::array::uniform3(-4.0..4.0_f64))
        .prop_map(|(position, turn)| Pose { position, rotation: rotation_exp(&turn).unwrap() });
    prop::collection::vec(pose, count)
}

fn follow() -> impl Strategy<Value = Follow> {
    prop_oneof![
        Just(Follow::OpenLoop),
        Just(Follow::Time),
        (0.01..2.0_f64, 0.1..4.0_f64).prop_map(|(position, rotation)| Follow::Gated { position, rotation }),
    ]
}

fn split(poses: &[Pose]) -> (Vec<Vector3>, Vec<Matrix3>) {
    poses.iter().map(|pose| (pose.position, pose.rotation)).unzip()
}

proptest! {
    #[test]
    fn a_batch_is_its_environments(
        (plan, again, objects, targets, eefs, chosen) in (0..5_usize).prop_flat_map(|count| (
            poses(count * HORIZON, 0.5), poses(count * HORIZON, 0.5), poses(count, 0.5), poses(count, 0.5),
            poses(count, 0.5), prop::collection::vec(any::<bool>(), count),
        )),
        follow in follow(), with_rotation: bool,
    ) {
        let law = DeltaPoseLaw::default();
        let count = objects.len();
        let mut batch = DeltaPoseBatch::new(count, follow).unwrap();
        let mut alone = vec![DeltaPoseController::new(follow).unwrap(); count];
        for (plan, chosen) in [(plan, vec![true; count]), (again, chosen)] {
            let (positions, rotations) = split(&plan);
            let plans = PlanBatch {
                horizon: HORIZON, positions: &positions, rotations: with_rotation.then_some(rotations.as_slice()),
            };
            batch.set_plans(plans, &objects, &chosen).unwrap();
            for i in (0..count).filter(|&i| chosen[i]) {
                let range = i * HORIZON..(i + 1) * HORIZON;
                let rotations = with_rotation.then(|| rotations[range.clone()].to_vec());
                alone[i].set_plan(positions[range].to_vec(), rotations, &objects[i]).unwrap();
            }
            for now in [&objects, &targets, &eefs] {
                let found = batch.targets(now).unwrap();
                let expected: Vec<Pose> = alone.iter_mut().zip(now).map(|(c, pose)| c.target(pose).unwrap()).collect();
                prop_assert_eq!(found, expected);
                for (one, other) in batch.controllers().iter().zip(&alone) {
                    prop_assert_eq!((one.index(), one.at_end()), (other.index(), other.at_end()));
                }
            }
        }
        let bases: Vec<Matrix3> = objects.iter().map(|pose| pose.rotation).collect();
        let found = actions(&law, &objects, &targets, &eefs, &bases).unwrap();
        for i in 0..count {
            prop_assert_eq!(found[i], law.action(&objects[i], &targets[i], &eefs[i], &bases[i]).unwrap());
        }
    }
}

#[test]
fn an_error_changes_nothing() {
    let here = vec![ORIGIN; 2];
    let mut batch = DeltaPoseBatch::new(2, Follow::Time).unwrap();
    let good = vec![[0.0; 3]; 2 * HORIZON];
    let plans = |positions| PlanBatch { horizon: HORIZON, positions, rotations: None };
    batch.set_plans(plans(&good), &here, &[true, false]).unwrap();
    let error = batch.targets(&here).unwrap_err();
    assert!(error.to_string().contains("environment 1 without a plan"), "{error}");
    assert_eq!(batch.controllers()[0].index(), 0, "the first has not advanced either");
    batch.set_plans(plans(&good), &here, &[true; 2]).unwrap();
    batch.targets(&here).unwrap();
    let mut broken = good.clone();
    broken[HORIZON][1] = f64::NAN;
    assert!(matches!(batch.set_plans(plans(&broken), &here, &[true; 2]), Err(Error::Value { what: "plan", .. })));
    let bad = [ORIGIN, Pose { rotation: [[0.0; 3]; 3], ..ORIGIN }];
    assert!(matches!(batch.targets(&bad), Err(Error::Value { what: "object", .. })));
    assert_eq!([0, 1].map(|i| batch.controllers()[i].index()), [1, 1], "the old plans go on");
}

#[test]
fn lengths_are_checked() {
    let (law, here) = (DeltaPoseLaw::default(), vec![ORIGIN; 2]);
    let mut batch = DeltaPoseBatch::new(2, Follow::Time).unwrap();
    let positions = vec![[0.0; 3]; 2 * HORIZON];
    let plans = PlanBatch { horizon: HORIZON, positions: &positions, rotations: None };
    let shape = |result: Result<(), Error>| matches!(result, Err(Error::Shape { .. }));
    assert!(shape(batch.set_plans(plans, &here[..1], &[true; 2])));
    assert!(shape(batch.set_plans(plans, &here, &[true; 3])));
    assert!(shape(batch.set_plans(PlanBatch { positions: &positions[1..], ..plans }, &here, &[true; 2])));
    assert!(shape(batch.set_plans(PlanBatch { rotations: Some(&[IDENTITY]), ..plans }, &here, &[true; 2])));
    let empty = PlanBatch { horizon: 0, positions: &[], rotations: None };
    assert!(shape(batch.set_plans(empty, &here, &[true; 2])));
    assert!(shape(batch.targets(&here[..1]).map(drop)));
    let bases = [IDENTITY; 2];
    assert!(shape(actions(&law, &here, &here[..1], &here, &bases).map(drop)));
    assert!(shape(actions(&law, &here, &here, &here[..1], &bases).map(drop)));
    assert!(shape(actions(&law, &here, &here, &here, &bases[..1]).map(drop)));
}
