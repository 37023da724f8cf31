//! Reading model files: safetensors with a JSON description under the metadata key `ocplanner`.
//!
//! A file may come from anywhere, so nothing in it is trusted: every fault becomes an [`Error::ModelFile`], never a panic.

use std::collections::BTreeMap;

use safetensors::{Dtype, SafeTensorError, SafeTensors};
use serde::de::DeserializeOwned;

use crate::error::{Error, Result};

/// The version of the description that this crate reads.
pub const FORMAT: u64 = 1;

/// The metadata key that holds the description.
pub const METADATA_KEY: &str = "ocplanner";

/// A parsed model file: its configuration and the tensors not yet taken.
#[derive(Debug, Clone)]
pub struct ModelFile {
    config: serde_json::Value,
    tensors: BTreeMap<String, Tensor>,
}

#[derive(Debug, Clone)]
struct Tensor {
    shape: Vec<usize>,
    values: Vec<f32>,
}

impl ModelFile {
    /// Parses the bytes of a file that must be of the given kind (`"planner"`).
    ///
    /// # Errors
    /// [`Error::ModelFile`] if the bytes are not a safetensors file, the description is missing or names another kind or
    /// format, or a tensor is not finite float32.
    pub fn parse(bytes: &[u8], kind: &str) -> Result<Self> {
        let broken = |e: SafeTensorError| fault(format!("it is not a whole safetensors file ({e}); copy it again"));
        let file = SafeTensors::deserialize(bytes).map_err(broken)?;
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(broken)?;
        let text = header.metadata().as_ref().and_then(|entries| entries.get(METADATA_KEY)).ok_or_else(|| {
            fault(format!("its metadata has no key {METADATA_KEY:?}; give a file that ocplanner wrote"))
        })?;
        let mut description: serde_json::Value =
            serde_json::from_str(text).map_err(|e| fault(format!("its metadata is not JSON: {e}")))?;
        let format = description.get("format").unwrap_or(&serde_json::Value::Null);
        if format.as_u64() != Some(FORMAT) {
            return Err(fault(format!(
                "its format is {format}, this version of ocplanner reads {FORMAT}; update ocplanner"
            )));
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

    /// The configuration as the type the caller expects; unknown keys are ignored.
    ///
    /// # Errors
    /// [`Error::ModelFile`] if a key is missing or has the wrong type.
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
    /// [`Error::ModelFile`] if it is missing or has another shape.
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
    /// [`Error::ModelFile`] if a tensor was not taken.
    pub fn finish(self) -> Result<()> {
        match self.tensors.len() {
            0 => Ok(()),
            count => {
                let names: Vec<&str> = self.tensors.keys().take(3).map(String::as_str).collect();
                Err(fault(format!("the configuration does not use {count} of its tensors: {}, ...", names.join(", "))))
            }
        }
    }
}

/// An [`Error::ModelFile`] with this explanation.
pub(crate) fn fault(problem: String) -> Error {
    Error::ModelFile { problem }
}
