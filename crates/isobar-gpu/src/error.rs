//! What can go wrong on the device, as values.

use isobar_core::RenderError;
use thiserror::Error;

/// Why the GPU cannot be used, or gave up.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum GpuError {
    /// No adapter was found, or none has the name asked for.
    #[error(
        "no GPU adapter {0}; install a Vulkan driver (software: Debian packages mesa-vulkan-drivers and libvulkan1), or use a cpu method"
    )]
    NoAdapter(String),
    /// The driver refused to give a device.
    #[error("adapter {adapter} refused a device: {reason}; choose another with ISOBAR_ADAPTER=NAME, or use a cpu method")]
    Request {
        /// Name of the adapter.
        adapter: String,
        /// The driver's words.
        reason: String,
    },
    /// The device is gone; open a new one.
    #[error("the GPU was lost ({0}); open the renderer again, or use a cpu method")]
    Lost(String),
    /// Device memory, or a limit on the size of one resource.
    #[error("{what} needs {bytes} bytes on the device, more than {limit} available")]
    Memory {
        /// What needed it.
        what: String,
        /// Bytes asked.
        bytes: u64,
        /// Bytes there, or the limit on one resource.
        limit: u64,
    },
    /// A texture or image is longer along one axis than the device allows.
    #[error("{what} is {size} long along one axis, the device allows {limit}")]
    Size {
        /// What is too long.
        what: String,
        /// Its length.
        size: u64,
        /// The device's limit.
        limit: u64,
    },
    /// The driver ended the loops of a ray before the shader did, so its hits are not all.
    #[error(
        "the driver ended the loops of pixel {x}, {y} early (software Vulkan does after 65,535 turns); larger steps, fewer isovalues, or a cpu method"
    )]
    Cut {
        /// Column.
        x: usize,
        /// Row.
        y: usize,
    },
    /// A shader or a call the driver or wgpu refuses: a mistake of ours or of the driver.
    #[error("{what}: {reason}")]
    Refused {
        /// What was being done.
        what: String,
        /// The words of wgpu.
        reason: String,
    },
}

impl From<GpuError> for RenderError {
    /// Memory and sizes become [`RenderError::Memory`], everything else [`RenderError::Device`].
    fn from(e: GpuError) -> Self {
        match e {
            GpuError::Memory { what, bytes, limit } => Self::Memory { what, bytes, limit },
            GpuError::Size { what, size, limit } => Self::Memory {
                what: format!("{what} (samples along one axis)"),
                bytes: size,
                limit,
            },
            other => Self::Device(other.to_string()),
        }
    }
}

/// The first line of a message, so that an error stays one line.
pub(crate) fn one_line(text: &str) -> String {
    let mut lines = text.lines().map(str::trim).filter(|l| !l.is_empty());
    let first = lines.next().unwrap_or("no reason given").to_owned();
    // wgpu puts the cause last: "In Device::create_buffer ... Caused by: ..."
    match lines.next_back() {
        Some(last) => format!("{first}: {last}"),
        None => first,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_one_line_with_a_remedy() {
        let e = GpuError::NoAdapter("was found".into());
        let text = e.to_string();
        assert!(text.contains("mesa-vulkan-drivers") && text.contains("libvulkan1") && !text.contains('\n'));
        assert_eq!(
            one_line("Validation Error\n\nCaused by:\n  too large\n"),
            "Validation Error: too large"
        );
        assert_eq!(one_line(""), "no reason given");
    }

    #[test]
    fn memory_stays_memory() {
        let e = GpuError::Memory {
            what: "x".into(),
            bytes: 2,
            limit: 1,
        };
        assert!(matches!(RenderError::from(e), RenderError::Memory { bytes: 2, limit: 1, .. }));
        assert!(matches!(
            RenderError::from(GpuError::Lost("x".into())),
            RenderError::Device(_)
        ));
    }
}
