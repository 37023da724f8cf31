//! Bindings of `ocplanner_core::pose`: its functions over arrays with any leading axes.

use numpy::{PyArrayDyn, PyUntypedArrayMethods};
use ocplanner_core::error::Result;
use ocplanner_core::pose::{self as core, Matrix3};
use pyo3::prelude::*;

use crate::arrays::{output, view};
use crate::error::{shape_error, to_python};

type Output<'py> = Bound<'py, PyArrayDyn<f64>>;

fn matrix(row: &[f64]) -> Matrix3 {
    std::array::from_fn(|i| std::array::from_fn(|j| row[3 * i + j]))
}

/// Applies `function` to the rows of an array with the last axes `trailing`, and returns rows with the axes `row`.
fn map_rows<'py, const N: usize>(
    value: &Bound<'py, PyAny>,
    name: &str,
    (shape, trailing): (&str, &[usize]),
    row: &[usize],
    function: impl Fn(&[f64]) -> Result<[f64; N]> + Sync,
) -> PyResult<Output<'py>> {
    let py = value.py();
    let array = view::<f64>(name, value, shape, trailing)?;
    let rows = array.as_slice()?;
    let width: usize = trailing.iter().product();
    let compute = || -> Result<Vec<f64>> {
        let mut all = Vec::with_capacity(rows.len() / width * N);
        for row in rows.chunks_exact(width) {
            all.extend_from_slice(&function(row)?);
        }
        Ok(all)
    };
    let values = py.detach(compute).map_err(|error| to_python(py, &error))?;
    let leading = &array.shape()[..array.shape().len() - trailing.len()];
    output(py, values, leading, row)
}

const ROT6D: (&str, &[usize]) = ("(..., 6)", &[6]);
const QUAT: (&str, &[usize]) = ("(..., 4)", &[4]);
const VECTOR: (&str, &[usize]) = ("(..., 3)", &[3]);
const MATRIX: (&str, &[usize]) = ("(..., 3, 3)", &[3, 3]);

fn flat(matrix: Matrix3) -> [f64; 9] {
    std::array::from_fn(|i| matrix[i / 3][i % 3])
}

/// (..., 6) float64 columns a1, a2 -> (..., 3, 3) rotations.
#[pyfunction]
pub fn rotation_from_6d<'py>(rot6d: &Bound<'py, PyAny>) -> PyResult<Output<'py>> {
    map_rows(rot6d, "rot6d", ROT6D, &[3, 3], |row| core::rotation_from_6d(&std::array::from_fn(|i| row[i])).map(flat))
}

/// (..., 3, 3) float64 rotations -> (..., 6), their first two columns.
#[pyfunction]
pub fn rotation_to_6d<'py>(rotation: &Bound<'py, PyAny>) -> PyResult<Output<'py>> {
    map_rows(rotation, "rotation", MATRIX, &[6], |row| Ok(core::rotation_to_6d(&matrix(row))))
}

/// (..., 4) float64 quaternions x, y, z, w -> (..., 3, 3) rotations.
#[pyfunction]
pub fn rotation_from_quat_xyzw<'py>(quat_xyzw: &Bound<'py, PyAny>) -> PyResult<Output<'py>> {
    map_rows(quat_xyzw, "quat_xyzw", QUAT, &[3, 3], |row| {
        core::rotation_from_quat_xyzw(&std::array::from_fn(|i| row[i])).map(flat)
    })
}

/// (..., 3, 3) float64 rotations -> (..., 4) unit quaternions x, y, z, w with w >= 0.
#[pyfunction]
pub fn quat_xyzw_from_rotation<'py>(rotation: &Bound<'py, PyAny>) -> PyResult<Output<'py>> {
    map_rows(rotation, "rotation", MATRIX, &[4], |row| core::quat_xyzw_from_rotation(&matrix(row)))
}

/// (..., 4) float64 quaternions w, x, y, z -> (..., 3, 3) rotations.
#[pyfunction]
pub fn rotation_from_quat_wxyz<'py>(quat_wxyz: &Bound<'py, PyAny>) -> PyResult<Output<'py>> {
    map_rows(quat_wxyz, "quat_wxyz", QUAT, &[3, 3], |row| {
        core::rotation_from_quat_xyzw(&[row[1], row[2], row[3], row[0]]).map(flat)
    })
}

/// (..., 3, 3) float64 rotations -> (..., 4) unit quaternions w, x, y, z with w >= 0.
#[pyfunction]
pub fn quat_wxyz_from_rotation<'py>(rotation: &Bound<'py, PyAny>) -> PyResult<Output<'py>> {
    map_rows(rotation, "rotation", MATRIX, &[4], |row| {
        core::quat_xyzw_from_rotation(&matrix(row)).map(|[x, y, z, w]| [w, x, y, z])
    })
}

/// (..., 3, 3) float64 rotations -> (..., 3) rotation vectors of length [0, pi].
#[pyfunction]
pub fn rotation_log<'py>(rotation: &Bound<'py, PyAny>) -> PyResult<Output<'py>> {
    map_rows(rotation, "rotation", MATRIX, &[3], |row| core::rotation_log(&matrix(row)))
}

/// (..., 3) float64 rotation vectors -> (..., 3, 3) rotations.
#[pyfunction]
pub fn rotation_exp<'py>(vector: &Bound<'py, PyAny>) -> PyResult<Output<'py>> {
    map_rows(vector, "vector", VECTOR, &[3, 3], |row| core::rotation_exp(&[row[0], row[1], row[2]]).map(flat))
}

/// Geodesic angles in [0, pi] between two arrays of rotations of the same shape (..., 3, 3) float64.
#[pyfunction]
pub fn geodesic_angle<'py>(a: &Bound<'py, PyAny>, b: &Bound<'py, PyAny>) -> PyResult<Output<'py>> {
    let py = a.py();
    let first = view::<f64>("a", a, MATRIX.0, MATRIX.1)?;
    let second = view::<f64>("b", b, MATRIX.0, MATRIX.1)?;
    if first.shape() != second.shape() {
        let message = format!("a and b: shapes {:?} and {:?} differ", first.shape(), second.shape());
        return Err(shape_error(py, message));
    }
    let (rows, others) = (first.as_slice()?, second.as_slice()?);
    let compute = || {
        let pairs = rows.chunks_exact(9).zip(others.chunks_exact(9));
        pairs.map(|(a, b)| core::geodesic_angle(&matrix(a), &matrix(b))).collect::<Result<Vec<f64>>>()
    };
    let angles = py.detach(compute).map_err(|error| to_python(py, &error))?;
    output(py, angles, &first.shape()[..first.shape().len() - 2], &[])
}
