//! Criterion's estimates, read from the folder it leaves.

use crate::results::Bench;
use serde::Deserialize;
use std::path::Path;
use std::time::SystemTime;

#[derive(Deserialize)]
struct Estimates {
    median: Estimate,
}

#[derive(Deserialize)]
struct Estimate {
    point_estimate: f64,
    confidence_interval: Interval,
}

#[derive(Deserialize)]
struct Interval {
    lower_bound: f64,
    upper_bound: f64,
}

#[derive(Deserialize)]
struct Id {
    full_id: String,
    #[serde(default)]
    throughput: Option<serde_json::Value>,
}

/// All estimates below `folder`, by name; those older than `since` belong to an earlier run and are left out. Unreadable files too: a bench that
/// was cut short leaves them.
#[must_use]
pub fn read(folder: &Path, since: SystemTime) -> Vec<Bench> {
    let mut all = Vec::new();
    collect(folder, since, &mut all, 0);
    all.sort_by(|a, b| a.name.cmp(&b.name));
    all
}

fn collect(folder: &Path, since: SystemTime, out: &mut Vec<Bench>, depth: usize) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if !path.is_dir() {
            continue;
        }
        if path.file_name().is_some_and(|n| n == "new") {
            out.extend(estimate(&path, since));
        } else if depth < 6 {
            collect(&path, since, out, depth + 1);
        }
    }
}

fn estimate(folder: &Path, since: SystemTime) -> Option<Bench> {
    let path = folder.join("estimates.json");
    if std::fs::metadata(&path).ok()?.modified().is_ok_and(|written| written < since) {
        return None;
    }
    let e: Estimates = serde_json::from_str(&std::fs::read_to_string(path).ok()?).ok()?;
    let id: Id = serde_json::from_str(&std::fs::read_to_string(folder.join("benchmark.json")).ok()?).ok()?;
    Some(Bench {
        name: id.full_id,
        median: e.median.point_estimate,
        interval: [
            e.median.confidence_interval.lower_bound,
            e.median.confidence_interval.upper_bound,
        ],
        elements: id.throughput.and_then(|t| t.get("Elements")?.as_u64()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn estimates_are_read_with_their_throughput_and_age() {
        let dir = tempfile::tempdir().unwrap();
        let new = dir.path().join("roots/degree 9/new");
        std::fs::create_dir_all(&new).unwrap();
        let interval = r#"{"confidence_level":0.95,"lower_bound":280.0,"upper_bound":320.0}"#;
        let median = format!(r#"{{"confidence_interval":{interval},"point_estimate":300.0,"standard_error":1.0}}"#);
        std::fs::write(
            new.join("estimates.json"),
            format!(r#"{{"mean":{median},"median":{median}}}"#),
        )
        .unwrap();
        let id = r#"{"group_id":"roots","function_id":"degree 9","full_id":"roots/degree 9","throughput":{"Elements":100}}"#;
        std::fs::write(new.join("benchmark.json"), id).unwrap();
        std::fs::create_dir_all(dir.path().join("cut/new")).unwrap();
        let all = read(dir.path(), SystemTime::UNIX_EPOCH);
        assert_eq!(all.len(), 1);
        assert_eq!(
            (all[0].name.as_str(), all[0].median, all[0].elements),
            ("roots/degree 9", 300.0, Some(100))
        );
        assert!(read(dir.path(), SystemTime::now() + Duration::from_secs(60)).is_empty());
    }
}
