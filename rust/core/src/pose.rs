//! Rigid-body poses, and rotations as matrices, 6-D rotations, quaternions and rotation vectors.
//!
//! Matrices are row-major and act on column vectors. A rotation named `rotation_a_b` maps coordinates in `b` to `a`.

use crate::error::{Error, Result};

/// A vector, metres or an axis.
pub type Vector3 = [f64; 3];
/// A row-major 3 x 3 matrix.
pub type Matrix3 = [[f64; 3]; 3];

/// The identity rotation.
pub const IDENTITY: Matrix3 = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Largest entry of `R^T R - I` in a matrix still accepted as a rotation; float32 sources err by about 1e-6.
pub const ORTHONORMAL_TOLERANCE: f64 = 1e-4;

/// The columns of a 6-D rotation count as parallel below this sine of the angle between them.
const PARALLEL: f64 = 1e-9;

/// Position (m) and rotation of a body in a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Origin of the body, metres.
    pub position: Vector3,
    /// Body -> frame.
    pub rotation: Matrix3,
}

impl Pose {
    /// A pose of finite numbers, whose matrix is a rotation.
    ///
    /// # Errors
    /// [`Error::Value`] naming `what`, if it is not.
    pub fn checked(what: &'static str, position: Vector3, rotation: Matrix3) -> Result<Self> {
        if !position.iter().all(|value| value.is_finite()) {
            return Err(Error::Value { what, found: format!("position {position:?}"), expected: "finite numbers" });
        }
        check_rotation(what, &rotation)?;
        Ok(Self { position, rotation })
    }
}

/// `a + b`.
#[must_use]
pub fn add(a: &Vector3, b: &Vector3) -> Vector3 {
    std::array::from_fn(|i| a[i] + b[i])
}

/// `a - b`.
#[must_use]
pub fn subtract(a: &Vector3, b: &Vector3) -> Vector3 {
    std::array::from_fn(|i| a[i] - b[i])
}

/// `factor * a`.
#[must_use]
pub fn scale(a: &Vector3, factor: f64) -> Vector3 {
    a.map(|x| x * factor)
}

/// The inner product.
#[must_use]
pub fn dot(a: &Vector3, b: &Vector3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The cross product.
#[must_use]
pub fn cross(a: &Vector3, b: &Vector3) -> Vector3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The Euclidean length.
#[must_use]
pub fn norm(a: &Vector3) -> f64 {
    dot(a, a).sqrt()
}

/// `R v`.
#[must_use]
pub fn rotate(rotation: &Matrix3, vector: &Vector3) -> Vector3 {
    rotation.map(|row| dot(&row, vector))
}

/// The matrix product `a b`.
#[must_use]
pub fn multiply(a: &Matrix3, b: &Matrix3) -> Matrix3 {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

/// The transpose, which inverts a rotation.
#[must_use]
pub fn transpose(a: &Matrix3) -> Matrix3 {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

/// Checks that a matrix is a rotation: finite, orthonormal within [`ORTHONORMAL_TOLERANCE`], with determinant +1.
///
/// # Errors
/// [`Error::Value`] if it is not.
pub fn check_rotation(what: &'static str, rotation: &Matrix3) -> Result<()> {
    let gram = multiply(&transpose(rotation), rotation);
    let orthonormal = (0..3).all(|i| (0..3).all(|j| (gram[i][j] - IDENTITY[i][j]).abs() <= ORTHONORMAL_TOLERANCE));
    let determinant = dot(&rotation[0], &cross(&rotation[1], &rotation[2]));
    if orthonormal && determinant > 0.0 {
        return Ok(());
    }
    Err(Error::Value { what, found: format!("{rotation:?}"), expected: "a rotation matrix" })
}

/// The rotation of a 6-D form, the columns `a1` and `a2` (Zhou et al. 2019), by Gram-Schmidt.
///
/// # Errors
/// [`Error::Value`] if a number is not finite, a column is zero, or the columns are parallel.
pub fn rotation_from_6d(rot6d: &[f64; 6]) -> Result<Matrix3> {
    let degenerate = || Error::Value {
        what: "6-D rotation",
        found: format!("{rot6d:?}"),
        expected: "two finite columns that are neither zero nor parallel",
    };
    let first = unit(&[rot6d[0], rot6d[1], rot6d[2]]).ok_or_else(degenerate)?;
    let raw_second = unit(&[rot6d[3], rot6d[4], rot6d[5]]).ok_or_else(degenerate)?;
    let rejected = subtract(&raw_second, &scale(&first, dot(&first, &raw_second)));
    if norm(&rejected) < PARALLEL {
        return Err(degenerate());
    }
    let second = unit(&rejected).ok_or_else(degenerate)?;
    // Nearly parallel columns lose digits to cancellation. A second pass restores orthogonality.
    let second = unit(&subtract(&second, &scale(&first, dot(&first, &second)))).ok_or_else(degenerate)?;
    Ok(transpose(&[first, second, cross(&first, &second)]))
}

/// The 6-D form of a rotation: its first two columns.
#[must_use]
pub fn rotation_to_6d(rotation: &Matrix3) -> [f64; 6] {
    let columns = transpose(rotation);
    [columns[0][0], columns[0][1], columns[0][2], columns[1][0], columns[1][1], columns[1][2]]
}

/// The rotation of a quaternion in the order x, y, z, w and of any length but zero.
///
/// Planners are trained on what this function reads from data sets, so its rounding is part of its contract: it divides by
/// the length, then multiplies and adds in the order written, without fused operations.
///
/// # Errors
/// [`Error::Value`] if it is zero or not finite.
pub fn rotation_from_quat_xyzw(quat_xyzw: &[f64; 4]) -> Result<Matrix3> {
    let largest = quat_xyzw.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    if !quat_xyzw.iter().all(|x| x.is_finite()) || largest == 0.0 {
        return Err(Error::Value {
            what: "quaternion (x, y, z, w)",
            found: format!("{quat_xyzw:?}"),
            expected: "finite numbers that are not all zero",
        });
    }
    let squared_length = |quat: &[f64; 4]| quat.iter().map(|x| x * x).sum::<f64>();
    // The squares of huge and of tiny numbers are representable only after scaling.
    let fits = squared_length(quat_xyzw).is_normal();
    let quat = if fits { *quat_xyzw } else { quat_xyzw.map(|x| x / largest) };
    let length = squared_length(&quat).sqrt();
    let [x, y, z, w] = quat.map(|c| c / length);
    Ok([
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ])
}

/// The unit quaternion of a rotation, in the order x, y, z, w with w >= 0, by Shepperd's method.
///
/// # Errors
/// [`Error::Value`] if the matrix is not a rotation.
pub fn quat_xyzw_from_rotation(rotation: &Matrix3) -> Result<[f64; 4]> {
    check_rotation("rotation", rotation)?;
    Ok(quat_of(rotation))
}

/// The rotation vector (axis times angle in [0, pi]) of a rotation.
///
/// # Errors
/// [`Error::Value`] if the matrix is not a rotation.
pub fn rotation_log(rotation: &Matrix3) -> Result<Vector3> {
    let [x, y, z, w] = quat_xyzw_from_rotation(rotation)?;
    let sine = norm(&[x, y, z]);
    // As the angle vanishes, angle / sin(angle / 2) tends to 2.
    let factor = if sine < 1e-12 { 2.0 } else { 2.0 * sine.atan2(w) / sine };
    Ok([x * factor, y * factor, z * factor])
}

/// The rotation of a rotation vector (axis times angle, of any length).
///
/// # Errors
/// [`Error::Value`] if a number is not finite.
pub fn rotation_exp(vector: &Vector3) -> Result<Matrix3> {
    let angle = norm(vector);
    if !angle.is_finite() {
        return Err(Error::Value { what: "rotation vector", found: format!("{vector:?}"), expected: "finite numbers" });
    }
    let half = 0.5 * angle;
    let factor = if half < 1e-8 { 0.5 } else { half.sin() / angle };
    rotation_from_quat_xyzw(&[vector[0] * factor, vector[1] * factor, vector[2] * factor, half.cos()])
}

/// The geodesic angle between two rotations, in [0, pi].
///
/// # Errors
/// [`Error::Value`] if a matrix is not a rotation.
pub fn geodesic_angle(a: &Matrix3, b: &Matrix3) -> Result<f64> {
    check_rotation("first rotation", a)?;
    check_rotation("second rotation", b)?;
    let [x, y, z, w] = quat_of(&multiply(&transpose(a), b));
    Ok(2.0 * norm(&[x, y, z]).atan2(w.abs()))
}

fn unit(vector: &Vector3) -> Option<Vector3> {
    let largest = vector.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
    if !vector.iter().all(|x| x.is_finite()) || largest == 0.0 {
        return None;
    }
    // Scaling first keeps the squares of huge and of tiny numbers representable.
    let scaled = vector.map(|x| x / largest);
    Some(scale(&scaled, 1.0 / norm(&scaled)))
}

fn quat_of(r: &Matrix3) -> [f64; 4] {
    let trace = r[0][0] + r[1][1] + r[2][2];
    let quat = if trace > 0.0 {
        [r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1], 1.0 + trace]
    } else if r[0][0] >= r[1][1] && r[0][0] >= r[2][2] {
        [1.0 + r[0][0] - r[1][1] - r[2][2], r[0][1] + r[1][0], r[0][2] + r[2][0], r[2][1] - r[1][2]]
    } else if r[1][1] >= r[2][2] {
        [r[0][1] + r[1][0], 1.0 - r[0][0] + r[1][1] - r[2][2], r[1][2] + r[2][1], r[0][2] - r[2][0]]
    } else {
        [r[0][2] + r[2][0], r[1][2] + r[2][1], 1.0 - r[0][0] - r[1][1] + r[2][2], r[1][0] - r[0][1]]
    };
    let length = quat.iter().map(|x| x * x).sum::<f64>().sqrt();
    let sign = if quat[3] < 0.0 { -1.0 } else { 1.0 };
    quat.map(|x| sign * x / length)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn close(a: &Matrix3, b: &Matrix3, tolerance: f64) -> bool {
        a.iter().flatten().zip(b.iter().flatten()).all(|(x, y)| (x - y).abs() <= tolerance)
    }

    fn component() -> impl Strategy<Value = f64> {
        prop_oneof![-2.0..2.0, -1e150..1e150, -1e-150..1e-150]
    }

    fn vector(range: f64) -> impl Strategy<Value = Vector3> {
        prop::array::uniform3(-range..range)
    }

    proptest! {
        #[test]
        fn six_numbers_give_a_rotation_or_an_error(rot6d in prop::array::uniform6(component())) {
            if let Ok(rotation) = rotation_from_6d(&rot6d) {
                prop_assert!(close(&multiply(&transpose(&rotation), &rotation), &IDENTITY, 1e-12));
                prop_assert!((dot(&rotation[0], &cross(&rotation[1], &rotation[2])) - 1.0).abs() < 1e-12);
                let again = rotation_from_6d(&rotation_to_6d(&rotation)).unwrap();
                prop_assert!(close(&again, &rotation, 1e-12));
            }
        }

        #[test]
        fn nearly_parallel_columns_stay_orthonormal(a in vector(1.0), b in vector(1.0), tilt in 1e-7..1.0) {
            prop_assume!(norm(&a) > 1e-2 && norm(&cross(&a, &b)) > 1e-2);
            let second = add(&a, &scale(&b, tilt));
            let rotation = rotation_from_6d(&[a[0], a[1], a[2], second[0], second[1], second[2]]).unwrap();
            prop_assert!(close(&multiply(&transpose(&rotation), &rotation), &IDENTITY, 1e-12));
        }

        #[test]
        fn quaternion_round_trip(axis in vector(6.0)) {
            let rotation = rotation_exp(&axis).unwrap();
            let quat = quat_xyzw_from_rotation(&rotation).unwrap();
            prop_assert!(quat[3] >= 0.0);
            prop_assert!(close(&rotation_from_quat_xyzw(&quat).unwrap(), &rotation, 1e-12));
            let longer = quat.map(|x| -7.5 * x);
            prop_assert!(close(&rotation_from_quat_xyzw(&longer).unwrap(), &rotation, 1e-12));
        }

        #[test]
        fn log_inverts_exp(axis in vector(1.8)) {
            prop_assume!(norm(&axis) < PI - 1e-6);
            let back = rotation_log(&rotation_exp(&axis).unwrap()).unwrap();
            prop_assert!(norm(&subtract(&back, &axis)) < 1e-9, "{axis:?} -> {back:?}");
        }

        #[test]
        fn exp_inverts_log_up_to_half_a_turn(axis in vector(1.0), angle in (PI - 1e-3)..PI) {
            prop_assume!(norm(&axis) > 1e-3);
            let rotation = rotation_exp(&scale(&axis, angle / norm(&axis))).unwrap();
            prop_assert!(close(&rotation_exp(&rotation_log(&rotation).unwrap()).unwrap(), &rotation, 1e-9));
        }

        #[test]
        fn geodesic_angle_is_the_length_of_the_log(axis in vector(1.0), a in vector(3.0)) {
            prop_assume!(norm(&axis) < PI);
            let first = rotation_exp(&a).unwrap();
            let second = multiply(&first, &rotation_exp(&axis).unwrap());
            prop_assert!((geodesic_angle(&first, &second).unwrap() - norm(&axis)).abs() < 1e-9);
            prop_assert!((geodesic_angle(&second, &first).unwrap() - norm(&axis)).abs() < 1e-9);
        }
    }

    #[test]
    fn degenerate_6d_rotations_are_errors() {
        let cases = [
            [0.0; 6],
            [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            [1.0, 2.0, 3.0, 2.0, 4.0, 6.0],
            [1.0, 2.0, 3.0, -1.0, -2.0, -3.0],
            [f64::NAN, 0.0, 0.0, 0.0, 1.0, 0.0],
            [1.0, 0.0, 0.0, 0.0, f64::INFINITY, 0.0],
        ];
        for case in cases {
            let error = rotation_from_6d(&case).unwrap_err();
            assert!(error.to_string().starts_with("6-D rotation"), "{error}");
        }
    }

    #[test]
    fn half_turns_have_a_log() {
        for axis in [[PI, 0.0, 0.0], [0.0, PI, 0.0], [0.0, 0.0, PI]] {
            let log = rotation_log(&rotation_exp(&axis).unwrap()).unwrap();
            assert!((norm(&log) - PI).abs() < 1e-12);
        }
        assert_eq!(rotation_log(&IDENTITY).unwrap(), [0.0; 3]);
    }

    #[test]
    fn quaternions_of_extreme_length_give_the_same_rotation() {
        let rotation = rotation_from_quat_xyzw(&[0.1, -0.2, 0.3, 0.9]).unwrap();
        for factor in [1e-320, 1e-300, 1e-160, 1e160, 1e300] {
            let quat = [0.1, -0.2, 0.3, 0.9].map(|x| x * factor);
            let tolerance = if factor < 1e-310 { 1e-3 } else { 1e-14 }; // few digits are left of 1e-321
            assert!(close(&rotation_from_quat_xyzw(&quat).unwrap(), &rotation, tolerance), "{factor}");
        }
    }

    #[test]
    fn a_quarter_turn_about_z_has_its_numbers_in_the_right_order() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let rotation = rotation_from_quat_xyzw(&[0.0, 0.0, half, half]).unwrap();
        assert!(close(&rotation, &[[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], 1e-15));
    }

    #[test]
    fn a_matrix_that_is_not_a_rotation_is_an_error() {
        let mirror = [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let nan = [[f64::NAN; 3]; 3];
        for matrix in [mirror, nan, [[2.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]], [[0.0; 3]; 3]] {
            assert!(rotation_log(&matrix).is_err());
            assert!(geodesic_angle(&matrix, &IDENTITY).is_err());
            assert!(geodesic_angle(&IDENTITY, &matrix).is_err());
        }
        assert!(rotation_from_quat_xyzw(&[0.0; 4]).is_err());
        assert!(rotation_exp(&[f64::INFINITY, 0.0, 0.0]).is_err());
    }
}
