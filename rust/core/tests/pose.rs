//! Six numbers make a rotation unless they are degenerate.

use ocplanner_core::pose::{
    IDENTITY, Matrix3, Vector3, add, cross, dot, multiply, norm, rotation_from_6d, scale, subtract, transpose,
};
use proptest::prelude::*;

fn unit_vectors() -> impl Strategy<Value = Vector3> {
    prop::array::uniform3(-1.0..1.0_f64)
        .prop_filter("not near zero", |v| norm(v) > 0.1)
        .prop_map(|v| scale(&v, 1.0 / norm(&v)))
}

/// Lengths over the whole range in which a vector of this length is representable.
fn lengths() -> impl Strategy<Value = f64> {
    (-300..300_i32, 1.0..10.0_f64, any::<bool>())
        .prop_map(|(power, digits, negative)| if negative { -digits } else { digits } * 10_f64.powi(power))
}

fn six(a: &Vector3, b: &Vector3) -> [f64; 6] {
    [a[0], a[1], a[2], b[0], b[1], b[2]]
}

fn distance(a: &Matrix3, b: &Matrix3) -> f64 {
    a.as_flattened().iter().zip(b.as_flattened()).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
}

proptest! {
    #[test]
    fn columns_that_are_not_parallel_give_a_rotation(
        first in unit_vectors(), other in unit_vectors(), tilt in -7.0..0.0_f64, lengths in (lengths(), lengths()),
    ) {
        let side = cross(&first, &other);
        prop_assume!(norm(&side) > 0.1);
        let side = scale(&side, 1.0 / norm(&side));
        let second = add(&first, &scale(&side, 10_f64.powf(tilt)));
        let rotation = rotation_from_6d(&six(&scale(&first, lengths.0), &scale(&second, lengths.1))).unwrap();
        prop_assert!(distance(&multiply(&transpose(&rotation), &rotation), &IDENTITY) < 1e-12);
        prop_assert!((dot(&rotation[0], &cross(&rotation[1], &rotation[2])) - 1.0).abs() < 1e-12);
        // The first column keeps its direction; the second stays in the plane of the two, on its own side.
        let columns = transpose(&rotation);
        prop_assert!(norm(&subtract(&columns[0], &scale(&first, lengths.0.signum()))) < 1e-12);
        let turned = dot(&columns[1], &side) * lengths.1.signum();
        prop_assert!(turned > 1.0 - 1e-6, "{turned}");
    }

    #[test]
    fn degenerate_columns_are_an_error(first in unit_vectors(), lengths in (lengths(), lengths()), which in 0..4_usize) {
        let zero = [0.0; 3];
        let parallel = (scale(&first, lengths.0), scale(&first, lengths.1));
        let (a, b) = [parallel, (zero, first), (first, zero), (first, [f64::NAN; 3])][which];
        let message = rotation_from_6d(&six(&a, &b)).unwrap_err().to_string();
        prop_assert!(message.contains("neither zero nor parallel"), "{message}");
    }
}
