//! Arguments other than arrays, read so that every fault in them raises one of the package's errors.

use pyo3::Borrowed;
use pyo3::exceptions::PyOverflowError;
use pyo3::prelude::*;
use pyo3::types::{PyString, PyTuple};

use crate::error::{named, shape_error};

/// An index or a count. A negative or enormous number raises `InvalidValueError`, not Python's `OverflowError`.
pub fn count(value: &Bound<'_, PyAny>) -> PyResult<usize> {
    let py = value.py();
    value.extract().map_err(|error: PyErr| {
        if !error.is_instance_of::<PyOverflowError>(py) {
            return error;
        }
        named(py, "InvalidValueError", format!("{value} is not a count or an index, expected 0 to {}", usize::MAX))
    })
}

/// A count, or None.
pub fn optional_count(value: &Bound<'_, PyAny>) -> PyResult<Option<usize>> {
    if value.is_none() { Ok(None) } else { count(value).map(Some) }
}

/// Longer than any list of arguments.
const LONGEST_LIST: usize = 1024;

/// The items of a list. Its stated length is not trusted: an array broadcast to 2^40 rows is a sequence too.
pub fn items<'py>(value: &Bound<'py, PyAny>) -> PyResult<Vec<Bound<'py, PyAny>>> {
    let items = value.try_iter()?.take(LONGEST_LIST + 1).collect::<PyResult<Vec<_>>>()?;
    if items.len() > LONGEST_LIST {
        return Err(shape_error(value.py(), format!("a list has more than {LONGEST_LIST} items")));
    }
    Ok(items)
}

/// A list of indices, each as [`count`] reads it.
pub fn counts(value: &Bound<'_, PyAny>) -> PyResult<Vec<usize>> {
    items(value)?.iter().map(count).collect()
}

/// A name. Text that is not Unicode raises `InvalidValueError`, not Python's `UnicodeEncodeError`.
pub fn name<'a>(value: &'a Bound<'_, PyAny>) -> PyResult<&'a str> {
    let text = value.cast::<PyString>()?;
    text.to_str().map_err(|_| named(value.py(), "InvalidValueError", "a name is not valid Unicode".to_owned()))
}

/// A tuple of two. One of another length raises `ShapeError`.
pub struct Pair<A, B>(pub A, pub B);

impl<'a, 'py, A, B> FromPyObject<'a, 'py> for Pair<A, B>
where
    A: for<'b> FromPyObject<'b, 'py>,
    B: for<'b> FromPyObject<'b, 'py>,
{
    type Error = PyErr;

    fn extract(value: Borrowed<'a, 'py, PyAny>) -> PyResult<Self> {
        let tuple = value.cast::<PyTuple>()?;
        if tuple.len() != 2 {
            let message = format!("a pose is a pair (position, rotation), found {} values", tuple.len());
            return Err(shape_error(value.py(), message));
        }
        let (first, second) = (tuple.get_item(0)?, tuple.get_item(1)?);
        Ok(Self(first.extract().map_err(Into::into)?, second.extract().map_err(Into::into)?))
    }
}
