//! `cargo xtask check`: `isobar check --strict` of every certified method on every data set it is meant for, as one table.

use crate::run::{cargo, root, target};
use anyhow::{Context, Result, bail};
use std::ffi::OsStr;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// A method with its settings, the kinds of data it is asked about, and of the synthetic fields the form of data.
struct Row {
    method: &'static str,
    set: &'static str,
    folders: &'static [&'static str],
    synthetic: &'static str,
}

const ROWS: [Row; 10] = [
    Row {
        method: "octree/cpu",
        set: "reconstruction=trilinear",
        folders: &["structured"],
        synthetic: "grid",
    },
    Row {
        method: "octree/cpu",
        set: "reconstruction=quadratic",
        folders: &["structured"],
        synthetic: "grid",
    },
    Row {
        method: "octree/cpu",
        set: "reconstruction=quadratic-interpolating",
        folders: &["structured"],
        synthetic: "grid",
    },
    Row {
        method: "octree/cpu",
        set: "reconstruction=cubic",
        folders: &["structured"],
        synthetic: "grid",
    },
    Row {
        method: "octree/cpu",
        set: "reconstruction=cubic-interpolating",
        folders: &["structured"],
        synthetic: "grid",
    },
    Row {
        method: "tetspline/cpu",
        set: "",
        folders: &["structured"],
        synthetic: "grid",
    },
    Row {
        method: "tetspline/cpu",
        set: "reconstruction=type6-prefiltered",
        folders: &["structured"],
        synthetic: "grid",
    },
    Row {
        method: "peaks/cpu",
        set: "mode=peak_only",
        folders: &["structured"],
        synthetic: "grid",
    },
    Row {
        method: "cellproj/cpu",
        set: "",
        folders: &["curvilinear", "unstructured"],
        synthetic: "tets",
    },
    Row {
        method: "nurbs/cpu",
        set: "",
        folders: &["nurbs", "highorder"],
        synthetic: "hexes",
    },
];

/// Synthetic fields with their isovalue; sizes as in the benches, for tetrahedra and hexahedra smaller.
const FIELDS: [(&str, usize, f64); 3] = [("marschner-lobb", 64, 0.5), ("gyroid", 256, 0.2), ("chmutov", 64, 0.0)];
const CELLS: usize = 32;

/// Names of fields in the manifest that the files call otherwise: magnitudes of vectors, and PLOT3D's fifth function.
const ALIASES: [(&str, &str); 4] = [("|v|", "momentum"), ("q5", "energy"), ("|DISPL|", "DISPL"), ("field", "")];

/// Ends of the names of files that are read through another one: payloads, PLOT3D's functions, MFEM's functions.
const COMPANIONS: [&str; 3] = [".raw.gz", "q.bin", ".gf"];

/// One data set at one isovalue; none where the manifest gives none (`-`: the program suggests one).
#[derive(Debug, PartialEq)]
struct Scene {
    data: String,
    field: String,
    isovalue: Option<f64>,
}

/// Scenes of a line of the manifest: `density 1.8; 1.0` is the field density at two isovalues.
fn scenes(file: &str, isovalues: &str) -> Vec<Scene> {
    if COMPANIONS.iter().any(|end| file.ends_with(end)) {
        return Vec::new();
    }
    let mut field = String::new();
    let mut out = Vec::new();
    for part in isovalues.split(';').map(str::trim) {
        let (named, number) = part.rsplit_once(' ').unwrap_or(("", part));
        if !named.is_empty() {
            let alias = ALIASES.iter().find(|(a, _)| *a == named).map(|(_, b)| *b);
            alias.unwrap_or(named).clone_into(&mut field);
        }
        let isovalue = number.parse().ok();
        if isovalue.is_some() || isovalues == "-" {
            out.push(Scene {
                data: file.to_owned(),
                field: field.clone(),
                isovalue,
            });
        }
    }
    out
}

/// The scenes of `MANIFEST.tsv` in `folder`, whose heading names the columns `file` and `isovalues`.
fn manifest(folder: &Path) -> Result<Vec<Scene>> {
    let at = folder.join("MANIFEST.tsv");
    let text = std::fs::read_to_string(&at).with_context(|| format!("{} could not be read", at.display()))?;
    let mut lines = text.lines();
    let head: Vec<&str> = lines.next().unwrap_or_default().split('\t').collect();
    let column = |name: &str| head.iter().position(|h| *h == name);
    let (Some(file), Some(isovalues)) = (column("file"), column("isovalues")) else {
        bail!("{}: the first line has no columns file and isovalues", at.display())
    };
    let mut out = Vec::new();
    for l in lines {
        let cells: Vec<&str> = l.split('\t').collect();
        let (Some(file), Some(isovalues)) = (cells.get(file), cells.get(isovalues)) else {
            continue;
        };
        let found = scenes(file, isovalues);
        // What names another file ("see ...") is read through that one.
        if found.is_empty() && !isovalues.starts_with("see ") && !COMPANIONS.iter().any(|end| file.ends_with(end)) {
            println!("{file} is left out: its isovalues ({isovalues}) are no numbers");
        }
        out.extend(found);
    }
    Ok(out)
}

/// `isobar VERB`, as built.
fn isobar(verb: &str) -> Command {
    let mut c = Command::new(target().join("release/isobar"));
    c.arg(verb).stdin(Stdio::null());
    c
}

/// The second isovalue that `isobar info` suggests: the middle one.
fn suggested(data: &OsStr) -> Result<f64> {
    let out = isobar("info").arg(data).output().context("isobar could not be started")?;
    let said = String::from_utf8_lossy(&out.stdout).into_owned();
    let tried = said
        .lines()
        .find_map(|l| l.strip_prefix("isovalues")?.trim().strip_prefix("try"));
    let middle = tried.and_then(|t| t.split(',').nth(1)?.trim().parse().ok());
    middle.with_context(|| format!("isobar info suggests no isovalue for {}", data.display()))
}

/// What `isobar check` says of `label`, a line of a label and a number.
fn count(said: &str, label: &str) -> Option<u64> {
    let line = said.lines().find(|l| l.starts_with(label))?;
    line[label.len()..].split_whitespace().next()?.parse().ok()
}

const COUNTS: [&str; 8] = [
    "pixels",
    "hits",
    "missed",
    "false",
    "wrong root",
    "wrong surface",
    "refuted",
    "undecidable",
];

/// Checks all, prints and writes the table; `false` when one is not clean.
pub(crate) fn check(args: &[String]) -> Result<bool> {
    let mut size = "512x384".to_owned();
    let mut only = String::new();
    let mut i = args.iter();
    while let Some(a) = i.next() {
        let place = match a.as_str() {
            "--size" => &mut size,
            "--only" => &mut only,
            other => bail!("there is no flag {other}; this command has --size WxH and --only METHOD"),
        };
        i.next().with_context(|| format!("{a} needs a value"))?.clone_into(place);
    }
    // A name that no row has would check nothing and call it clean.
    if !only.is_empty() && !ROWS.iter().any(|r| r.method == only) {
        let mut known: Vec<&str> = ROWS.iter().map(|r| r.method).collect();
        known.dedup();
        bail!(
            "--only {only}: this command checks {}; the others claim nothing by themselves",
            known.join(", ")
        );
    }
    if !cargo(&["build", "--release", "-p", "isobar"]).status()?.success() {
        bail!("isobar did not build; the compiler's reason is above");
    }
    let folder = std::env::var_os("ISOBAR_DATA").map_or_else(|| root().join("../shared/data"), PathBuf::from);
    let files = if folder.join("MANIFEST.tsv").exists() {
        manifest(&folder)?
    } else {
        println!("no MANIFEST.tsv in {} (ISOBAR_DATA): synthetic fields only", folder.display());
        Vec::new()
    };
    let mut table = format!(
        "| data | isovalue | method | {} | unclaimed | claimed |\n|{}\n",
        COUNTS.join(" | "),
        "---|".repeat(13)
    );
    print!("{table}");
    let (mut bad, mut all) = (0, 0);
    for row in ROWS.iter().filter(|r| only.is_empty() || r.method == only) {
        let synthetic = FIELDS.iter().map(|&(name, n, isovalue)| {
            let n = if row.synthetic == "grid" { n } else { CELLS };
            let data = format!("synthetic:{name},n={n},as={}", row.synthetic);
            (None, data, String::new(), Some(isovalue))
        });
        let of_files = files
            .iter()
            .filter(|s| row.folders.iter().any(|f| s.data.split('/').next() == Some(*f)))
            .map(|s| (Some(folder.join(&s.data)), s.data.clone(), s.field.clone(), s.isovalue));
        for (path, data, field, isovalue) in synthetic.chain(of_files).collect::<Vec<_>>() {
            let given = path.map_or_else(|| data.clone().into(), PathBuf::into_os_string);
            all += 1;
            let isovalue = match isovalue.map_or_else(|| suggested(&given), Ok) {
                Ok(c) => c,
                Err(e) => {
                    let line = format!("| {data} | | {} {} | {e:#} |\n", row.method, row.set);
                    print!("{line}");
                    table += &line;
                    bad += 1;
                    continue;
                }
            };
            let mut c = isobar("check");
            c.arg("--strict").arg(given);
            c.args(["--method", row.method, "--size", &size, &format!("--isovalue={isovalue}")]);
            if !row.set.is_empty() {
                c.args(["--set", row.set]);
            }
            if !field.is_empty() {
                c.args(["--field", &field]);
            }
            if row.method == "cellproj/cpu" {
                c.arg("--cell-to-point");
            }
            let out = c.output().context("isobar could not be started")?;
            let said = String::from_utf8_lossy(&out.stdout).into_owned();
            let place = if field.is_empty() { data } else { format!("{data} {field}") };
            let line = line(&said, &String::from_utf8_lossy(&out.stderr));
            let line = format!("| {place} | {isovalue} | {} {} | {line}\n", row.method, row.set);
            print!("{line}");
            table += &line;
            bad += usize::from(!out.status.success());
        }
    }
    let _ = writeln!(table, "\n{} of {all} are clean, at {size}.", all - bad);
    println!("\n{} of {all} are clean, at {size}.", all - bad);
    let reports = root().join("reports");
    std::fs::create_dir_all(&reports)?;
    let (new, at) = (reports.join("checked.md.new"), reports.join("checked.md"));
    std::fs::write(&new, table).and_then(|()| std::fs::rename(&new, &at))?;
    println!("{}", at.display());
    Ok(bad == 0)
}

/// The counts as cells of the table, or the program's own line where it gave none.
fn line(said: &str, error: &str) -> String {
    let counts: Option<Vec<u64>> = COUNTS.iter().map(|l| count(said, l)).collect();
    let (Some(counts), Some(unclaimed)) = (counts, count(said, "unclaimed")) else {
        return format!("{} |", error.trim().replace('\n', " "));
    };
    let share = 100.0 * (1.0 - unclaimed as f64 / counts[0] as f64);
    let counts = counts.iter().map(u64::to_string).collect::<Vec<_>>().join(" | ");
    format!("{counts} | {unclaimed} | {share:.4} % |")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn isovalues_of_the_manifest() {
        let said = |s: &str| {
            let all = scenes("f", s).into_iter().map(|s| (s.field, s.isovalue));
            all.collect::<Vec<_>>()
        };
        let f = |s: &str, isovalue: f64| (s.to_owned(), Some(isovalue));
        assert_eq!(said("120; 180"), [f("", 120.0), f("", 180.0)]);
        assert_eq!(said("density 1.8; 1.0"), [f("density", 1.8), f("density", 1.0)]);
        assert_eq!(said("|v| 0.7; q5 0.5"), [f("momentum", 0.7), f("energy", 0.5)]);
        assert_eq!(said("Nodal Stress-0 3e6"), [f("Nodal Stress-0", 3e6)]);
        assert_eq!(said("-"), [(String::new(), None)]);
        assert_eq!(said("see bluntfinxyz.bin"), []);
        assert_eq!(scenes("a/payload.raw.gz", "-"), []);
    }

    #[test]
    fn counts_are_read_and_errors_shown() {
        let said = "octree/cpu on x\npixels  100\nhits 7\nmissed 1  no\nfalse 2 hit\nwrong root 3\nwrong surface 4\nrefuted 5\nundecidable 6\nunclaimed 20\n";
        assert_eq!(line(said, ""), "100 | 7 | 1 | 2 | 3 | 4 | 5 | 6 | 20 | 80.0000 % |");
        assert_eq!(line("", "isobar: no file\n"), "isobar: no file |");
    }
}
