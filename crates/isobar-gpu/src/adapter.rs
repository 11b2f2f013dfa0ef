//! Which adapters there are, which one is taken, and what it can do.

use crate::GpuError;
use crate::error::one_line;
use std::fmt;

/// What an adapter is and what it allows; goes into reports and statistics.
#[derive(Debug, Clone, PartialEq)]
pub struct AdapterReport {
    /// Name of the device.
    pub name: String,
    /// Driver and its version.
    pub driver: String,
    /// `vulkan`, `metal`, ...
    pub backend: String,
    /// `discrete`, `integrated`, `virtual`, `cpu` (software), `other`.
    pub device_type: &'static str,
    /// Largest side of a 3D texture.
    pub max_texture_3d: u32,
    /// Largest side of a 2D texture.
    pub max_texture_2d: u32,
    /// Largest part of a buffer a shader may see, bytes.
    pub max_storage_binding: u64,
    /// Largest buffer, bytes.
    pub max_buffer: u64,
    /// Most invocations of one workgroup.
    pub max_workgroup: u32,
    /// Whether passes can be timed on the device.
    pub timestamps: bool,
    /// Whether 32-bit float textures can be filtered by the hardware.
    pub filters_f32: bool,
}

impl AdapterReport {
    pub(crate) fn of(adapter: &wgpu::Adapter) -> Self {
        let info = adapter.get_info();
        let limits = adapter.limits();
        let features = adapter.features();
        Self {
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
            name: info.name,
            backend: info.backend.to_string(),
            device_type: type_name(info.device_type),
            max_texture_3d: limits.max_texture_dimension_3d,
            max_texture_2d: limits.max_texture_dimension_2d,
            max_storage_binding: limits.max_storage_buffer_binding_size,
            max_buffer: limits.max_buffer_size,
            max_workgroup: limits.max_compute_invocations_per_workgroup,
            timestamps: features.contains(wgpu::Features::TIMESTAMP_QUERY),
            filters_f32: features.contains(wgpu::Features::FLOAT32_FILTERABLE),
        }
    }

    /// Whether the device is a program on the CPU: its times say nothing about GPUs.
    #[must_use]
    pub fn is_software(&self) -> bool {
        self.device_type == "cpu"
    }
}

impl fmt::Display for AdapterReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}, {}, {})", self.name, self.device_type, self.backend, self.driver)
    }
}

fn type_name(t: wgpu::DeviceType) -> &'static str {
    match t {
        wgpu::DeviceType::DiscreteGpu => "discrete",
        wgpu::DeviceType::IntegratedGpu => "integrated",
        wgpu::DeviceType::VirtualGpu => "virtual",
        wgpu::DeviceType::Cpu => "cpu",
        wgpu::DeviceType::Other => "other",
    }
}

/// Order of preference: hardware first, software last.
fn rank(device_type: &str) -> u8 {
    match device_type {
        "discrete" => 0,
        "integrated" => 1,
        "virtual" => 2,
        "other" => 3,
        _ => 4,
    }
}

/// The wgpu instance of this process's Vulkan loader, without debug layers; `None` where this build has no backend for the platform.
pub(crate) fn instance() -> Option<wgpu::Instance> {
    if wgpu::Instance::enabled_backend_features().is_empty() {
        return None;
    }
    let mut d = wgpu::InstanceDescriptor::new_without_display_handle();
    d.flags = wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL;
    Some(wgpu::Instance::new(d))
}

/// All adapters of this machine, best first. Empty where there is no loader, driver or device.
#[must_use]
pub fn adapters() -> Vec<AdapterReport> {
    instance().map_or_else(Vec::new, |i| list(&i).iter().map(AdapterReport::of).collect())
}

/// Adapters, best first; the driver's order among equals.
fn list(instance: &wgpu::Instance) -> Vec<wgpu::Adapter> {
    let mut all = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    all.sort_by_key(|a| rank(type_name(a.get_info().device_type)));
    all
}

/// The best adapter whose name or driver contains `wanted` (case ignored).
pub(crate) fn choose(instance: &wgpu::Instance, wanted: Option<&str>) -> Result<wgpu::Adapter, GpuError> {
    let mut all = list(instance);
    let reports: Vec<_> = all.iter().map(AdapterReport::of).collect();
    if reports.is_empty()
        && let Some(why) = absent_driver(|v| std::env::var_os(v))
    {
        return Err(GpuError::NoAdapter(why));
    }
    pick(&reports, wanted).map(|i| all.swap_remove(i))
}

/// Why there may be none although a driver is installed: the Vulkan loader looks only at the files these variables name.
fn absent_driver(variable: impl Fn(&str) -> Option<std::ffi::OsString>) -> Option<String> {
    ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"].into_iter().find_map(|name| {
        let list = variable(name)?;
        let missing = std::env::split_paths(&list).find(|p| !p.is_file())?;
        Some(format!(
            "was found: {name} names {}, which is no file; unset the variable or name a driver's .json",
            one_line(&missing.display().to_string())
        ))
    })
}

/// Which of `reports` (best first) is taken.
fn pick(reports: &[AdapterReport], wanted: Option<&str>) -> Result<usize, GpuError> {
    if reports.is_empty() {
        return Err(GpuError::NoAdapter("was found".into()));
    }
    let Some(wanted) = wanted.map(str::trim).filter(|w| !w.is_empty()) else {
        return Ok(0);
    };
    let low = wanted.to_lowercase();
    reports
        .iter()
        .position(|r| r.name.to_lowercase().contains(&low) || r.driver.to_lowercase().contains(&low))
        .ok_or_else(|| {
            let names: Vec<_> = reports.iter().map(|r| r.name.as_str()).collect();
            GpuError::NoAdapter(format!(
                "is named like ISOBAR_ADAPTER={} (there are: {})",
                one_line(wanted),
                names.join(", ")
            ))
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_variable_that_names_no_driver_is_said() {
        let why = absent_driver(|v| (v == "VK_ICD_FILENAMES").then(|| "/nonexistent.json".into()));
        assert!(why.is_some_and(|w| w.contains("VK_ICD_FILENAMES names /nonexistent.json")));
        assert_eq!(absent_driver(|_| None), None);
        let here = std::env::current_exe().unwrap();
        assert_eq!(absent_driver(|_| Some(here.clone().into())), None);
    }

    fn report(name: &str, device_type: &'static str) -> AdapterReport {
        AdapterReport {
            name: name.into(),
            driver: format!("{name}-driver 1.2"),
            backend: "vulkan".into(),
            device_type,
            max_texture_3d: 2048,
            max_texture_2d: 8192,
            max_storage_binding: 1 << 27,
            max_buffer: 1 << 28,
            max_workgroup: 256,
            timestamps: true,
            filters_f32: true,
        }
    }

    #[test]
    fn the_name_asked_for_wins_else_the_best() {
        let all = [report("Big Card", "discrete"), report("llvmpipe", "cpu")];
        assert_eq!(pick(&all, None), Ok(0));
        assert_eq!(pick(&all, Some(" ")), Ok(0));
        assert_eq!(pick(&all, Some("LLVM")), Ok(1));
        assert_eq!(pick(&all, Some("card-driver")), Ok(0));
        let e = pick(&all, Some("nothing")).unwrap_err().to_string();
        assert!(e.contains("nothing") && e.contains("Big Card, llvmpipe"), "{e}");
        assert!(matches!(pick(&[], None), Err(GpuError::NoAdapter(_))));
    }

    #[test]
    fn hardware_comes_before_software() {
        let order = ["discrete", "integrated", "virtual", "other", "cpu"];
        assert!(order.windows(2).all(|w| rank(w[0]) < rank(w[1])));
        assert!(report("x", "cpu").is_software() && !report("x", "virtual").is_software());
    }
}
