//! The device: opened once, shared by all methods, its failures turned into values.

use crate::error::one_line;
use crate::{AdapterReport, GpuError, adapter};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// A device with its queue. Clones share it.
#[derive(Debug, Clone)]
pub struct Gpu {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    report: AdapterReport,
    device: wgpu::Device,
    queue: wgpu::Queue,
    failures: Arc<Failures>,
}

/// What the callbacks of wgpu reported.
#[derive(Debug, Default)]
struct Failures {
    lost: OnceLock<String>,
    uncaptured: Mutex<Option<String>>,
}

/// Opened devices are shared through here.
static SHARED: Mutex<Option<Gpu>> = Mutex::new(None);

impl Gpu {
    /// Opens a device of its own on the best adapter, or on the first whose name or driver contains the environment variable
    /// `ISOBAR_ADAPTER`. Hardware is preferred over software.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] without a Vulkan loader, driver or device; [`GpuError::Request`] where the driver refuses.
    pub fn open() -> Result<Self, GpuError> {
        Self::open_named(std::env::var("ISOBAR_ADAPTER").ok().as_deref())
    }

    /// As [`Gpu::open`] with the name given.
    ///
    /// # Errors
    /// As [`Gpu::open`].
    pub fn open_named(wanted: Option<&str>) -> Result<Self, GpuError> {
        let instance = adapter::instance()
            .ok_or_else(|| GpuError::NoAdapter("can be used: this build has no backend for this platform".into()))?;
        let adapter = adapter::choose(&instance, wanted)?;
        let report = AdapterReport::of(&adapter);
        let optional = wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::FLOAT32_FILTERABLE;
        let request = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("isobar"),
            required_features: adapter.features() & optional,
            // Everything the adapter has: volumes and frames need it, and what does not fit is an error with numbers.
            required_limits: adapter.limits(),
            ..wgpu::DeviceDescriptor::default()
        });
        let (device, queue) = pollster::block_on(request).map_err(|e| GpuError::Request {
            adapter: report.name.clone(),
            reason: one_line(&e.to_string()),
        })?;
        let failures = Arc::new(Failures::default());
        let seen = Arc::clone(&failures);
        device.set_device_lost_callback(move |reason, text| {
            let _ = seen.lost.set(format!("{reason:?}: {}", one_line(&text)));
        });
        let seen = Arc::clone(&failures);
        device.on_uncaptured_error(Arc::new(move |e: wgpu::Error| {
            log::warn!("wgpu: {e}");
            let mut first = seen.uncaptured.lock().unwrap_or_else(PoisonError::into_inner);
            first.get_or_insert_with(|| one_line(&e.to_string()));
        }));
        log::info!("opened {report}");
        Ok(Self {
            inner: Arc::new(Inner {
                report,
                device,
                queue,
                failures,
            }),
        })
    }

    /// The device all methods of this process share; opened by the first call, and again after a loss.
    ///
    /// # Errors
    /// As [`Gpu::open`]. A failure is not remembered: the next call tries again.
    pub fn shared() -> Result<Self, GpuError> {
        let mut shared = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(gpu) = shared.as_ref().filter(|g| g.check().is_ok()) {
            return Ok(gpu.clone());
        }
        let gpu = Self::open()?;
        *shared = Some(gpu.clone());
        Ok(gpu)
    }

    /// The adapter.
    #[must_use]
    pub fn report(&self) -> &AdapterReport {
        &self.inner.report
    }

    /// The wgpu device. Calls that can fail belong inside [`Gpu::guard`].
    #[must_use]
    pub fn device(&self) -> &wgpu::Device {
        &self.inner.device
    }

    /// The wgpu queue.
    #[must_use]
    pub fn queue(&self) -> &wgpu::Queue {
        &self.inner.queue
    }

    /// Whether the device still works.
    ///
    /// # Errors
    /// [`GpuError::Lost`] once the driver reported its loss, [`GpuError::Refused`] after an error outside every [`Gpu::guard`].
    pub fn check(&self) -> Result<(), GpuError> {
        if let Some(reason) = self.inner.failures.lost.get() {
            return Err(GpuError::Lost(reason.clone()));
        }
        let uncaptured = self.inner.failures.uncaptured.lock().unwrap_or_else(PoisonError::into_inner);
        uncaptured.as_ref().map_or(Ok(()), |reason| {
            Err(GpuError::Refused {
                what: "the device".into(),
                reason: reason.clone(),
            })
        })
    }

    /// Runs `work`, which makes calls on the device for `what` (a resource of `bytes` bytes, 0: none), and turns what wgpu
    /// reports into an error. Errors of this thread only; calls may be nested.
    ///
    /// # Errors
    /// [`GpuError::Lost`], [`GpuError::Memory`] when the driver is out of memory, [`GpuError::Refused`].
    pub fn guard<T>(&self, what: &str, bytes: u64, work: impl FnOnce() -> T) -> Result<T, GpuError> {
        self.check()?;
        let scopes = [
            wgpu::ErrorFilter::Internal,
            wgpu::ErrorFilter::Validation,
            wgpu::ErrorFilter::OutOfMemory,
        ]
        .map(|f| self.device().push_error_scope(f));
        let out = work();
        let mut error = None;
        // Scopes are popped in reverse; out of memory is the cause where several were reported.
        for scope in scopes.into_iter().rev() {
            let found = pollster::block_on(scope.pop());
            error = error.or(found);
        }
        self.check()?;
        match error {
            None => Ok(out),
            Some(wgpu::Error::OutOfMemory { .. }) => Err(GpuError::Memory {
                what: what.to_owned(),
                bytes,
                limit: self.report().max_buffer,
            }),
            Some(e) => Err(GpuError::Refused {
                what: what.to_owned(),
                reason: one_line(&e.to_string()),
            }),
        }
    }

    /// Blocks until all submitted work is done.
    ///
    /// # Errors
    /// [`GpuError::Lost`].
    pub fn wait(&self) -> Result<(), GpuError> {
        self.check()?;
        // wgpu 30 panics inside Device::poll when the wait itself fails, which is how a lost device shows first.
        let polled = catch_unwind(AssertUnwindSafe(|| self.device().poll(wgpu::PollType::wait_indefinitely())));
        let reason = match polled {
            Ok(Ok(_)) => return self.check(),
            Ok(Err(e)) => one_line(&e.to_string()),
            Err(_) => "waiting for it failed".to_owned(),
        };
        let _ = self.inner.failures.lost.set(reason);
        self.check()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_adapter;

    #[test]
    fn an_unknown_adapter_is_an_error_with_the_names() {
        let Some(gpu) = test_adapter("an_unknown_adapter_is_an_error_with_the_names") else {
            return;
        };
        let e = Gpu::open_named(Some("no such card")).unwrap_err().to_string();
        assert!(e.contains(&gpu.report().name), "{e}");
        let again = Gpu::open_named(Some(&gpu.report().name.to_uppercase())).unwrap();
        assert_eq!(again.report(), gpu.report());
    }

    #[test]
    fn a_destroyed_device_is_lost_not_a_panic() {
        let Some(gpu) = test_adapter("a_destroyed_device_is_lost_not_a_panic") else {
            return;
        };
        let own = Gpu::open_named(Some(&gpu.report().name)).unwrap();
        own.check().unwrap();
        own.device().destroy();
        assert!(matches!(own.wait(), Err(GpuError::Lost(_))), "{:?}", own.check());
        assert!(matches!(own.storage("x", &[0u8; 16]), Err(GpuError::Lost(_))));
        // The shared one is another device.
        gpu.check().unwrap();
    }

    #[test]
    fn refusals_are_values_and_do_not_spoil_the_device() {
        let Some(gpu) = test_adapter("refusals_are_values_and_do_not_spoil_the_device") else {
            return;
        };
        let e = gpu
            .guard("a texture", 0, || {
                gpu.device().create_buffer(&wgpu::BufferDescriptor {
                    label: None,
                    size: 4,
                    usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::MAP_WRITE,
                    mapped_at_creation: false,
                })
            })
            .unwrap_err();
        assert!(matches!(e, GpuError::Refused { .. }), "{e}");
        assert!(!e.to_string().contains('\n'));
        gpu.check().unwrap();
    }

    #[test]
    fn an_error_outside_a_guard_is_kept() {
        let Some(gpu) = test_adapter("an_error_outside_a_guard_is_kept") else {
            return;
        };
        let own = Gpu::open_named(Some(&gpu.report().name)).unwrap();
        let _ = own.device().create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: 4,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::MAP_WRITE,
            mapped_at_creation: false,
        });
        assert!(matches!(own.check(), Err(GpuError::Refused { .. })));
    }
}
