//! The one error type of the crate.

/// What can go wrong in the core. Each variant names the thing, what was found and what was expected.
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
    #[error("{what}: found {found}, expected {expected}")]
    Value {
        /// The argument.
        what: &'static str,
        /// Its value.
        found: String,
        /// What it should be.
        expected: &'static str,
    },
    /// A model file is damaged, or was made for something else.
    #[error("cannot use the model file: {problem}")]
    ModelFile {
        /// What is wrong with it, and a remedy where there is one.
        problem: String,
    },
}

/// The crate's result.
pub type Result<T> = std::result::Result<T, Error>;
