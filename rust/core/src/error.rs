//! The one error type of the crate.

/// What can go wrong in the core. Each variant names the thing, the value found and the value wanted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An array has the wrong shape.
    #[error("{what}: shape is {found:?}, expected {expected}")]
    Shape {
        /// The argument.
        what: &'static str,
        /// Its shape.
        found: Vec<usize>,
        /// The shape it should have.
        expected: String,
    },
    /// A number is outside its domain (NaN and infinity included).
    #[error("{what}: {found} is not {expected}")]
    Value {
        /// The argument.
        what: &'static str,
        /// Its value.
        found: String,
        /// What it should be.
        expected: &'static str,
    },
    /// A weight file is damaged, or made for something else.
    #[error("not a valid weight file: {problem}")]
    WeightFile {
        /// What is wrong with it.
        problem: String,
    },
}

/// The crate's result.
pub type Result<T> = std::result::Result<T, Error>;
