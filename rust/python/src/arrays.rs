//! NumPy arrays: checked views on the way in, owned arrays on the way out.

use numpy::ndarray::{ArrayD, IxDyn};
use numpy::{Element, IntoPyArray, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn};
use numpy::{PyUntypedArray, PyUntypedArrayMethods, dtype};
use pyo3::intern;
use pyo3::prelude::*;

use crate::error::shape_error;

/// A read-only view of a C-contiguous array of `T`, or a `ShapeError` that names the argument and says what was found.
///
/// `shape` is the expected shape as text, such as `"(..., 6)"`, and `trailing` its last axes.
pub fn view<'py, T: Element>(
    what: &str,
    value: &Bound<'py, PyAny>,
    shape: &str,
    trailing: &[usize],
) -> PyResult<PyReadonlyArrayDyn<'py, T>> {
    let array = strided_view::<T>(what, value, &format!("C-contiguous {shape}"), trailing)?;
    if !array.is_c_contiguous() {
        let remedy = "found another memory order; use numpy.ascontiguousarray";
        let wanted = dtype::<T>(value.py());
        let message = format!("{what}: expected a C-contiguous {shape} array of {wanted}, {remedy}");
        return Err(shape_error(value.py(), message));
    }
    Ok(array)
}

/// As [`view`], in any memory order.
pub fn strided_view<'py, T: Element>(
    what: &str,
    value: &Bound<'py, PyAny>,
    shape: &str,
    trailing: &[usize],
) -> PyResult<PyReadonlyArrayDyn<'py, T>> {
    let py = value.py();
    let wanted = dtype::<T>(py);
    let expected = || format!("expected a {shape} array of {wanted}");
    let Ok(untyped) = value.cast::<PyUntypedArray>() else {
        let found = value.get_type().name()?.to_string();
        return Err(shape_error(py, format!("{what}: {}, found {found}", expected())));
    };
    let Ok(array) = value.cast::<PyArrayDyn<T>>() else {
        let found = untyped.dtype();
        let order =
            if found.kind() == wanted.kind() && found.itemsize() == wanted.itemsize() { " byte-swapped" } else { "" };
        return Err(shape_error(py, format!("{what}: {}, found{order} dtype {found}", expected())));
    };
    let found = array.shape();
    if found.len() < trailing.len() || !found.ends_with(trailing) {
        return Err(shape_error(py, format!("{what}: {}, found shape {found:?}", expected())));
    }
    if !array.is_aligned() {
        return Err(shape_error(py, format!("{what}: {}, found misaligned memory; use numpy.copy", expected())));
    }
    array.try_readonly().map_err(|_| shape_error(py, format!("{what}: the array is being written elsewhere")))
}

/// The values of a (T,) array of bool.
///
/// NumPy lets such an array hold bytes other than 0 and 1, which a Rust `bool` must never hold, so it is read as bytes.
pub fn flags(what: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<bool>> {
    let checked = view_rows::<bool>(what, value, "(T,)", &[])?;
    let bytes = checked.call_method1(intern!(value.py(), "view"), (dtype::<u8>(value.py()),))?;
    Ok(view::<u8>(what, &bytes, "(T,)", &[])?.as_slice()?.iter().map(|byte| *byte != 0).collect())
}

/// As [`view`], for an array with exactly one axis before the trailing ones.
pub fn view_rows<'py, T: Element>(
    what: &str,
    value: &Bound<'py, PyAny>,
    shape: &str,
    trailing: &[usize],
) -> PyResult<PyReadonlyArrayDyn<'py, T>> {
    let array = view::<T>(what, value, shape, trailing)?;
    if array.ndim() != trailing.len() + 1 {
        let message = format!("{what}: expected shape {shape}, found {:?}", array.shape());
        return Err(shape_error(value.py(), message));
    }
    Ok(array)
}

/// The most axes an array may have.
const MOST_AXES: usize = 32;

/// An array of `values` in C order, with the axes `leading`, then `trailing`.
pub fn output<'py, T: Element>(
    py: Python<'py>,
    values: Vec<T>,
    leading: &[usize],
    trailing: &[usize],
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let shape = [leading, trailing].concat();
    if shape.len() > MOST_AXES {
        let message = format!("the result would have {} axes, NumPy allows {MOST_AXES}", shape.len());
        return Err(shape_error(py, message));
    }
    let array = ArrayD::from_shape_vec(IxDyn(&shape), values).map_err(|error| shape_error(py, error.to_string()))?;
    Ok(array.into_pyarray(py))
}
