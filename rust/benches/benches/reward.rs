//! The rewards of an episode.
#![allow(missing_docs, reason = "criterion's macros write undocumented functions")]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use ocplanner_benches::noise;
use ocplanner_core::pose::{Matrix3, Vector3, rotation_exp};
use ocplanner_core::reward::{EpisodeEnd, Form, Poses, RewardLaw};

const TRANSITIONS: usize = 150;

fn rewards(criterion: &mut Criterion) {
    let vectors = |count: usize| -> Vec<Vector3> {
        noise(3 * count).chunks_exact(3).map(|v| [v[0], v[1], v[2]].map(f64::from)).collect()
    };
    let positions = vectors(2 * TRANSITIONS);
    let rotations: Vec<Matrix3> = positions.iter().map(|axis| rotation_exp(axis).expect("finite numbers")).collect();
    let (planned, achieved) = positions.split_at(TRANSITIONS);
    let (planned_rotation, achieved_rotation) = rotations.split_at(TRANSITIONS);
    let planned = Poses { position: planned, rotation: Some(planned_rotation) };
    let achieved = Poses { position: achieved, rotation: Some(achieved_rotation) };
    let grasping = [true; TRANSITIONS];
    let mut group = criterion.benchmark_group("reward, 150 transitions");
    group.throughput(Throughput::Elements(TRANSITIONS as u64));
    for (name, form) in [
        ("penalty", Form::Penalty),
        ("exp", Form::Exp { scale: 2.5e-4 }),
        ("potential", Form::Potential { gamma: 0.99 }),
    ] {
        let law = RewardLaw { form, ..RewardLaw::default() };
        group.bench_function(name, |bench| {
            bench.iter(|| law.rewards(planned, achieved, &grasping, &[], EpisodeEnd::Terminated).expect("valid poses"));
        });
    }
    group.finish();
}

criterion_group!(benches, rewards);
criterion_main!(benches);
