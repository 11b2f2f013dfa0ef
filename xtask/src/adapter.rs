//! Finding, and where allowed installing, a Vulkan driver, so that GPU tests run on any machine.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Environment that lets wgpu find the driver.
#[derive(Debug, Clone, Default)]
pub(crate) struct Adapter {
    /// Whether a driver and the loader are there.
    pub(crate) found: bool,
    /// One line for a person.
    pub(crate) said: String,
    /// Variables to set for what is started next.
    pub(crate) env: Vec<(&'static str, String)>,
}

/// Debian's packages of the loader and of the software driver lavapipe.
const PACKAGES: [&str; 2] = ["mesa-vulkan-drivers", "libvulkan1"];

/// Looks for a driver; installs the software one where there is none, it is allowed, and apt-get can be used without a password.
pub(crate) fn ensure(no_install: bool) -> Adapter {
    if !cfg!(target_os = "linux") {
        return Adapter {
            found: true,
            said: "adapter: not looked for on this system; wgpu decides".into(),
            env: Vec::new(),
        };
    }
    let mut icds = icd_files();
    if icds.is_empty() || !loader() {
        match install(no_install) {
            Ok(()) => icds = icd_files(),
            Err(remedy) => {
                return Adapter {
                    found: false,
                    said: format!("adapter: no Vulkan driver is installed; {remedy}"),
                    env: Vec::new(),
                };
            }
        }
    }
    describe(&icds, has_device(), loader())
}

/// Says what the drivers found amount to on a machine with or without a graphics device.
fn describe(icds: &[PathBuf], device: bool, loader: bool) -> Adapter {
    let lavapipe = icds.iter().find(|p| name(p).starts_with("lvp"));
    let mut env = Vec::new();
    if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        // Mesa warns without it.
        env.push(("XDG_RUNTIME_DIR", std::env::temp_dir().display().to_string()));
    }
    let chosen = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"]
        .iter()
        .any(|v| std::env::var_os(v).is_some());
    let (found, said) = match (lavapipe, icds.is_empty() || !loader) {
        (_, true) => (false, "adapter: no Vulkan driver is installed".to_owned()),
        _ if chosen => (true, "adapter: the Vulkan driver that VK_DRIVER_FILES names".to_owned()),
        (Some(lvp), _) if !device => {
            env.push(("VK_DRIVER_FILES", lvp.display().to_string()));
            (
                true,
                "adapter: no graphics device, the software driver lavapipe is used".to_owned(),
            )
        }
        _ if device => (
            true,
            format!("adapter: {} Vulkan driver(s) and a graphics device", icds.len()),
        ),
        _ => (
            false,
            "adapter: Vulkan drivers are installed but there is no graphics device and no software driver".to_owned(),
        ),
    };
    Adapter { found, said, env }
}

fn name(p: &Path) -> String {
    p.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Driver descriptions where the Vulkan loader looks for them.
fn icd_files() -> Vec<PathBuf> {
    for variable in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"] {
        if let Some(list) = std::env::var_os(variable) {
            return std::env::split_paths(&list).filter(|p| p.is_file()).collect();
        }
    }
    let mut folders: Vec<PathBuf> = ["/usr/share", "/usr/local/share", "/etc", "/usr/local/etc"]
        .map(PathBuf::from)
        .to_vec();
    folders.extend(std::env::var_os("XDG_DATA_DIRS").iter().flat_map(std::env::split_paths));
    folders.extend(std::env::var_os("HOME").map(|h| PathBuf::from(h).join(".local/share")));
    let mut files: Vec<_> = folders
        .iter()
        .filter_map(|f| std::fs::read_dir(f.join("vulkan/icd.d")).ok())
        .flat_map(|d| d.flatten().map(|e| e.path()))
        .filter(|p| p.extension().is_some_and(|e| e == "json"))
        .collect();
    files.sort();
    files.dedup();
    files
}

/// Whether the Vulkan loader is installed.
fn loader() -> bool {
    let mut folders: Vec<PathBuf> = std::env::var_os("LD_LIBRARY_PATH")
        .iter()
        .flat_map(std::env::split_paths)
        .collect();
    folders.extend(["/usr/lib", "/usr/lib64", "/lib", "/lib64", "/usr/local/lib"].map(PathBuf::from));
    let triplets = folders.clone();
    for f in triplets {
        let inner = std::fs::read_dir(f).into_iter().flatten().flatten().map(|e| e.path());
        folders.extend(inner.filter(|p| name(p).ends_with("-linux-gnu")));
    }
    folders.iter().any(|f| f.join("libvulkan.so.1").exists())
}

/// Whether the kernel shows a graphics device.
fn has_device() -> bool {
    let renders = |p: &Path| std::fs::read_dir(p).is_ok_and(|d| d.flatten().any(|e| name(&e.path()).starts_with("renderD")));
    renders(Path::new("/dev/dri")) || Path::new("/dev/nvidiactl").exists() || Path::new("/dev/dxg").exists()
}

/// Installs the software driver, aloud.
fn install(no_install: bool) -> Result<(), String> {
    let line = format!("apt-get install -y --no-install-recommends {}", PACKAGES.join(" "));
    let type_this = format!("type `sudo {line}`");
    if no_install {
        return Err(format!("--no-install forbids installing it; {type_this}"));
    }
    if !succeeds(Command::new("apt-get").arg("--version")) {
        return Err("install lavapipe (Mesa's software Vulkan driver) and libvulkan.so.1 with this system's packages".into());
    }
    let root = Command::new("id")
        .arg("-u")
        .output()
        .is_ok_and(|o| o.stdout.trim_ascii() == b"0");
    let prefix: &[&str] = if root {
        &[]
    } else if succeeds(Command::new("sudo").args(["-n", "true"])) {
        &["sudo", "-n"]
    } else {
        return Err(format!("installing needs a password; {type_this}"));
    };
    println!("adapter: installing the software Vulkan driver: {line}");
    let apt = |args: &[&str]| -> bool {
        let words: Vec<&str> = prefix
            .iter()
            .copied()
            .chain(["apt-get", "-qq"])
            .chain(args.iter().copied())
            .collect();
        let mut c = Command::new(words[0]);
        c.args(&words[1..]).env("DEBIAN_FRONTEND", "noninteractive");
        c.stdin(Stdio::null()).status().is_ok_and(|s| s.success())
    };
    let install = ["install", "-y", "--no-install-recommends", PACKAGES[0], PACKAGES[1]];
    if apt(&install) || (apt(&["update"]) && apt(&install)) {
        Ok(())
    } else {
        Err(format!("apt-get failed (its reason is above); {type_this}"))
    }
}

fn succeeds(c: &mut Command) -> bool {
    let quiet = c.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    quiet.status().is_ok_and(|s| s.success())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_software_driver_is_pinned_where_no_device_is() {
        if ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"]
            .iter()
            .any(|v| std::env::var_os(v).is_some())
        {
            println!("SKIPPED: a driver is chosen by the environment");
            return;
        }
        let icds = [
            PathBuf::from("/d/intel_icd.x86_64.json"),
            PathBuf::from("/d/lvp_icd.x86_64.json"),
        ];
        let pinned = |a: &Adapter| a.env.iter().any(|(k, v)| *k == "VK_DRIVER_FILES" && v.contains("lvp"));
        let a = describe(&icds, false, true);
        assert!(a.found && pinned(&a));
        let a = describe(&icds, true, true);
        assert!(a.found && !pinned(&a));
        assert!(!describe(&icds[..1], false, true).found);
        assert!(!describe(&[], true, true).found);
        assert!(!describe(&icds, false, false).found);
    }
}
