//! Views of NumPy arrays, checked before anything is read.

use numpy::ndarray::Dimension;
use numpy::{Element, PyArray, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyReadonlyArray, PyReadonlyArrayDyn};
use numpy::{PyUntypedArray, PyUntypedArrayMethods, dtype};
use pyo3::prelude::*;
use pyo3::{Borrowed, intern};

use crate::errors::shape_error;

/// A read-only view of a C-contiguous array of `T`, or a `ShapeError` that names the argument and what it is instead.
///
/// `shape` says in words what is expected, `"(..., 6)"`; its trailing numbers are `trailing`.
pub fn view<'py, T: Element>(
    what: &str,
    value: &Bound<'py, PyAny>,
    shape: &str,
    trailing: &[usize],
) -> PyResult<PyReadonlyArrayDyn<'py, T>> {
    let py = value.py();
    let wanted = dtype::<T>(py);
    let expected = || format!("expected a C-contiguous {shape} array of {wanted}");
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
    if !array.is_c_contiguous() {
        let remedy = "found another memory order; use numpy.ascontiguousarray";
        return Err(shape_error(py, format!("{what}: {}, {remedy}", expected())));
    }
    if !array.is_aligned() {
        return Err(shape_error(py, format!("{what}: {}, found misaligned memory; use numpy.copy", expected())));
    }
    array.try_readonly().map_err(|_| shape_error(py, format!("{what}: the array is being written elsewhere")))
}

/// The values of a (T,) array of bool.
///
/// NumPy lets such an array hold other bytes than 0 and 1, which a Rust `bool` must not: they are read as bytes.
pub fn flags(what: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<bool>> {
    let checked = view_rows::<bool>(what, value, "(T,)", &[])?;
    let bytes = checked.call_method1(intern!(value.py(), "view"), (dtype::<u8>(value.py()),))?;
    Ok(view::<u8>(what, &bytes, "(T,)", &[])?.as_slice()?.iter().map(|byte| *byte != 0).collect())
}

/// As [`view`], of an array with exactly one axis before the trailing ones.
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

/// A read-only float64 array with the axes of `D`, in any memory order; anything else is a `ShapeError`.
pub struct Numbers<'py, D: Dimension>(pub PyReadonlyArray<'py, f64, D>);

impl<'py, D: Dimension> FromPyObject<'_, 'py> for Numbers<'py, D> {
    type Error = PyErr;

    fn extract(value: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let (py, axes) = (value.py(), D::NDIM.unwrap_or(0));
        let Ok(array) = value.cast::<PyArray<f64, D>>() else {
            let found = match value.cast::<PyUntypedArray>() {
                Ok(array) => format!("an array of {} with shape {:?}", array.dtype(), array.shape()),
                Err(_) => value.get_type().name()?.to_string(),
            };
            return Err(shape_error(py, format!("expected an array of float64 with {axes} axes, found {found}")));
        };
        if !array.is_aligned() {
            return Err(shape_error(py, "an array is misaligned in memory; use numpy.copy".to_owned()));
        }
        let view =
            array.try_readonly().map_err(|_| shape_error(py, "an array is being written elsewhere".to_owned()))?;
        Ok(Self(view))
    }
}
