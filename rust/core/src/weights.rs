//! Reading weight files: safetensors with a JSON description under the metadata key `ocplanner`.
//!
//! A file may come from anywhere, so nothing in it is trusted: every fault is an [`Error::WeightFile`], never a panic.

use std::collections::BTreeMap;

use safetensors::{Dtype, SafeTensors};
use serde::de::DeserializeOwned;

use crate::error::{Error, Result};

/// The version of the description that this crate reads.
pub const FORMAT: u64 = 1;

/// The metadata key that holds the description.
pub const METADATA_KEY: &str = "ocplanner";

/// A parsed weight file: its configuration and the tensors not yet taken.
#[derive(Debug, Clone)]
pub struct WeightFile {
    config: serde_json::Value,
    tensors: BTreeMap<String, Tensor>,
}

#[derive(Debug, Clone)]
struct Tensor {
    shape: Vec<usize>,
    values: Vec<f32>,
}

impl WeightFile {
    /// Parses the bytes of a file that must be of the given kind (`"planner"`).
    ///
    /// # Errors
    /// [`Error::WeightFile`] if the bytes are no safetensors file, the description is missing or of another kind or
    /// format, or a tensor is not finite float32.
    pub fn parse(bytes: &[u8], kind: &str) -> Result<Self> {
        let file = SafeTensors::deserialize(bytes).map_err(|e| fault(format!("{e}")))?;
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(|e| fault(format!("{e}")))?;
        let text = header.metadata().as_ref().and_then(|entries| entries.get(METADATA_KEY)).ok_or_else(|| {
            fault(format!("the metadata lacks the key {METADATA_KEY:?}; was it written by ocplanner?"))
        })?;
        let mut description: serde_json::Value =
            serde_json::from_str(text).map_err(|e| fault(format!("the metadata is not JSON: {e}")))?;
        let format = description.get("format").and_then(serde_json::Value::as_u64);
        if format != Some(FORMAT) {
            return Err(fault(format!("format {format:?}, but this version reads format {FORMAT}")));
        }
        let found_kind = description.get("kind").and_then(serde_json::Value::as_str);
        if found_kind != Some(kind) {
            return Err(fault(format!("it is a {} file, not a {kind} file", found_kind.unwrap_or("nameless"))));
        }
        let config = description.get_mut("config").map(serde_json::Value::take).unwrap_or_default();
        let mut tensors = BTreeMap::new();
        for (name, view) in file.iter() {
            if view.dtype() != Dtype::F32 {
                return Err(fault(format!("tensor {name}: dtype is {:?}, expected F32", view.dtype())));
            }
            let values: Vec<f32> = view
                .data()
                .chunks_exact(4)
                .map(|chunk| f32::from_le_bytes([chunk[0], chunk[1], chunk[2], chunk[3]]))
                .collect();
            if let Some(position) = values.iter().position(|x| !x.is_finite()) {
                return Err(fault(format!("tensor {name}: value {position} is {}", values[position])));
            }
            tensors.insert(name.to_owned(), Tensor { shape: view.shape().to_vec(), values });
        }
        Ok(Self { config, tensors })
    }

    /// The configuration as the type that the caller expects; unknown keys are ignored.
    ///
    /// # Errors
    /// [`Error::WeightFile`] if a key is missing or has the wrong type.
    pub fn config<T: DeserializeOwned>(&self) -> Result<T> {
        T::deserialize(&self.config).map_err(|e| fault(format!("configuration: {e}")))
    }

    /// The whole configuration as JSON text.
    #[must_use]
    pub fn config_json(&self) -> String {
        self.config.to_string()
    }

    /// Takes a tensor out of the file, row-major.
    ///
    /// # Errors
    /// [`Error::WeightFile`] if it is missing or has another shape.
    pub fn take(&mut self, name: &str, shape: &[usize]) -> Result<Vec<f32>> {
        let tensor = self.tensors.remove(name).ok_or_else(|| fault(format!("tensor {name} is missing")))?;
        if tensor.shape != shape {
            return Err(fault(format!("tensor {name}: shape is {:?}, expected {shape:?}", tensor.shape)));
        }
        Ok(tensor.values)
    }

    /// Ends the reading.
    ///
    /// # Errors
    /// [`Error::WeightFile`] if tensors are left that nobody took.
    pub fn finish(self) -> Result<()> {
        match self.tensors.len() {
            0 => Ok(()),
            count => {
                let names: Vec<&str> = self.tensors.keys().take(3).map(String::as_str).collect();
                Err(fault(format!("{count} tensors that the configuration does not use: {}, ...", names.join(", "))))
            }
        }
    }
}

/// An [`Error::WeightFile`] with this explanation.
pub(crate) fn fault(problem: String) -> Error {
    Error::WeightFile { problem }
}
