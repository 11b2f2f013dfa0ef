//! The built program, as a user runs it: every verb on small synthetic data, and every kind of bad input.

mod hostile;
mod outputs;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

struct Place {
    dir: TempDir,
}

impl Place {
    fn new() -> Self {
        Self {
            dir: tempfile::tempdir().expect("a temporary folder"),
        }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn file(&self, name: &str, bytes: &[u8]) -> String {
        let p = self.path(name);
        std::fs::write(&p, bytes).expect("a temporary file");
        p.to_str().expect("UTF-8").to_owned()
    }

    fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = std::fs::read_dir(self.dir.path())
            .expect("the folder")
            .map(|e| e.expect("an entry").file_name().to_string_lossy().into_owned())
            .filter(|n| n != "cache")
            .collect();
        names.sort();
        names
    }

    fn run(&self, line: &str) -> Output {
        self.run_words(&line.split_whitespace().collect::<Vec<_>>())
    }

    fn run_words(&self, words: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_isobar"))
            .args(words)
            .current_dir(self.dir.path())
            .env("ISOBAR_CACHE", self.path("cache"))
            .output()
            .expect("the program starts")
    }

    fn good(&self, line: &str) -> String {
        let o = self.run(line);
        assert_eq!(o.status.code(), Some(0), "{line}\n{}", text(&o.stderr));
        text(&o.stdout)
    }

    /// Exit 2, one line on standard error that has `names`, nothing on standard output, no panic, no file made.
    fn bad(&self, line: &str, names: &str) {
        let before = self.names();
        let o = self.run(line);
        let said = text(&o.stderr);
        assert_eq!(o.status.code(), Some(2), "{line}\n{said}");
        assert_eq!(said.lines().count(), 1, "{line}\n{said}");
        assert!(said.contains(names), "{line}\n{said}");
        assert!(
            !said.contains("panicked") && !said.contains("internal error"),
            "{line}\n{said}"
        );
        assert!(o.stdout.is_empty(), "{line}\n{}", text(&o.stdout));
        assert_eq!(before, self.names(), "{line}");
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(path).expect("the file")).expect("JSON")
}

/// A 3^3 NRRD of floats with one NaN.
fn nan_file(p: &Place) -> String {
    let mut bytes = b"NRRD0004\ntype: float\ndimension: 3\nsizes: 3 3 3\nencoding: raw\nendian: little\n\n".to_vec();
    for i in 0..27 {
        bytes.extend((if i == 13 { f32::NAN } else { i as f32 }).to_le_bytes());
    }
    p.file("nan.nrrd", &bytes)
}

const SPHERE: &str = "synthetic:sphere,n=16";

#[test]
fn methods_lists_every_method() {
    let p = Place::new();
    let t = p.good("methods");
    for m in isobar::methods() {
        assert!(t.contains(m.info().id), "{t}");
    }
    let j: serde_json::Value = serde_json::from_str(&p.good("methods --json")).expect("JSON");
    let march = j
        .as_array()
        .expect("a list")
        .iter()
        .find(|m| m["id"] == "march/cpu")
        .expect("march/cpu");
    assert_eq!(march["starts"], true);
    assert!(
        march["knobs"]
            .as_array()
            .expect("knobs")
            .iter()
            .any(|k| k["name"] == "reconstruction")
    );
}

#[test]
fn info_describes_data() {
    let p = Place::new();
    let t = p.good(&format!("info {SPHERE}"));
    assert!(t.contains("16 x 16 x 16") && t.contains("histogram"), "{t}");
    let j: serde_json::Value = serde_json::from_str(&p.good(&format!("info {SPHERE} --json"))).expect("JSON");
    assert_eq!(j["dims"], serde_json::json!([16, 16, 16]));
    assert_eq!(j["nan"], 0);
    assert_eq!(j["suggested_isovalues"][0], 1.0);
    let file = nan_file(&p);
    let j: serde_json::Value = serde_json::from_str(&p.good(&format!("info {file} --json"))).expect("JSON");
    assert_eq!(
        (&j["nan"], &j["range"]),
        (&serde_json::json!(1), &serde_json::json!([0.0, 26.0]))
    );
    for kind in ["algebraic", "tets", "hexes"] {
        assert!(p.good(&format!("info synthetic:sphere,n=5,as={kind}")).contains(kind));
    }
}

/// Hardcases D5: x = 4 u^2 - 3 u turns back on itself.
#[test]
fn info_tells_folded_elements() {
    let p = Place::new();
    let mut points = Vec::new();
    for n in 0..12 {
        points.push(format!("[{},{},{},1]", [0.0, -1.5, 1.0][n % 3], n / 3 % 2, n / 6));
    }
    let file = p.file(
        "fold.json",
        format!(
            r#"{{"format":"nurbs-volume/1","patches":[{{"degree":[2,1,1],"n":[3,2,2],"knots":[[0,0,0,1,1,1],[0,0,1,1],[0,0,1,1]],"control_points":[{}],"field":[0,1,2,0,1,2,0,1,2,0,1,2]}}]}}"#,
            points.join(",")
        )
        .as_bytes(),
    );
    let t = p.good(&format!("info {file}"));
    assert!(t.contains("orientation  1 folded"), "{t}");
    let j: serde_json::Value = serde_json::from_str(&p.good(&format!("info {file} --json"))).expect("JSON");
    assert_eq!(
        j["orientation"],
        serde_json::json!({"right": 0, "left": 0, "vanishing": 0, "folded": 1})
    );
    assert!(p.good("info synthetic:sphere,n=5,as=hexes").contains("64 right-handed"));
}

#[test]
fn render_writes_all_formats_and_stats() {
    let p = Place::new();
    p.good(&format!(
        "render {SPHERE} --method march/cpu --isovalue 1:1:#ff0000 --size 40x30 -o a.png -o b.exr -o c.npz --stats s.json --repeat 2"
    ));
    assert_eq!(p.names(), ["a.png", "b.exr", "c.npz", "s.json"]);
    let picture = image::open(p.path("a.png")).expect("PNG").to_rgb8();
    assert_eq!(picture.dimensions(), (40, 30));
    assert_eq!(picture.get_pixel(0, 0).0, [255; 3]);
    let middle = picture.get_pixel(20, 15).0;
    assert!(middle[0] > 150 && middle[1] == 0 && middle[2] == 0, "{middle:?}");

    let s = json(&p.path("s.json"));
    for key in ["load", "open", "data", "surfaces", "view", "read"] {
        assert!(s["seconds"][key].as_f64().expect(key) >= 0.0);
    }
    assert_eq!(s["seconds"]["render"]["n"], 2);
    assert!(s["seconds"]["render"]["median"].as_f64().expect("median") > 0.0);
    assert!(s["cpu_seconds"]["render"]["median"].as_f64().is_some());
    assert!(s["memory"]["process_peak"].as_u64().expect("peak") > 1 << 20);
    assert_eq!(s["settings"]["knobs"]["reconstruction"], "trilinear");
    assert_eq!(s["method"], "march/cpu");
    let hit = s["pixels"]["hit"].as_u64().expect("hit");
    assert!(hit > 100 && hit < 1000, "{hit}");
}

/// Name, type, shape and values (as f64) of an array of an npz.
fn arrays(path: &Path) -> Vec<(String, String, Vec<u64>, Vec<f64>)> {
    let mut zip = zip::ZipArchive::new(std::fs::File::open(path).expect("npz")).expect("a zip archive");
    (0..zip.len())
        .map(|i| {
            let entry = zip.by_index(i).expect("an entry");
            let name = entry.name().expect("a name").into_owned();
            let array = npyz::NpyFile::new(entry).expect("npy");
            let dtype = array.dtype().descr();
            let shape = array.shape().to_vec();
            let values: Vec<f64> = match dtype.as_str() {
                "'<f8'" => array.into_vec().expect("f64"),
                "'<f4'" => array.into_vec::<f32>().expect("f32").into_iter().map(f64::from).collect(),
                "'<u2'" => array.into_vec::<u16>().expect("u16").into_iter().map(f64::from).collect(),
                "'|u1'" => array.into_vec::<u8>().expect("u8").into_iter().map(f64::from).collect(),
                other => panic!("{name}: {other}"),
            };
            (name, dtype, shape, values)
        })
        .collect()
}

#[test]
fn npz_has_the_contracts_arrays() {
    let p = Place::new();
    let all = |layers: &[u64]| -> Vec<(String, String, Vec<u64>)> {
        let image = [30, 40];
        [
            ("t", "'<f8'", true, vec![]),
            ("point", "'<f8'", true, vec![3]),
            ("normal", "'<f4'", true, vec![3]),
            ("surface", "'|u1'", true, vec![]),
            ("t_error", "'<f8'", true, vec![]),
            ("hits", "'<u2'", false, vec![]),
            ("rgba", "'<f4'", false, vec![4]),
            ("claim", "'|u1'", false, vec![]),
        ]
        .into_iter()
        .map(|(n, t, layered, tail)| {
            let head: &[u64] = if layered { layers } else { &[] };
            (format!("{n}.npy"), t.to_owned(), [head, &image, &tail].concat())
        })
        .collect()
    };
    for (flag, axis) in [("", vec![]), ("--layers 1", vec![1]), ("--layers 3", vec![3])] {
        p.good(&format!(
            "render {SPHERE} --method march/cpu --isovalue 1 --size 40x30 {flag} -o a.npz"
        ));
        let got = arrays(&p.path("a.npz"));
        let shapes: Vec<_> = got.iter().map(|(n, t, s, _)| (n.clone(), t.clone(), s.clone())).collect();
        assert_eq!(shapes, all(&axis), "{flag}");
        let of = |name: &str| &got.iter().find(|a| a.0 == format!("{name}.npy")).expect(name).3;
        let (t, surface, hits, point) = (of("t"), of("surface"), of("hits"), of("point"));
        assert_eq!((t[0], surface[0], hits[0]), (f64::INFINITY, 255.0, 0.0));
        let at = 15 * 40 + 20;
        assert_eq!(surface[at], 0.0);
        assert!(hits[at] >= 1.0);
        let r = (0..3).map(|c| point[3 * at + c].powi(2)).sum::<f64>().sqrt();
        assert!((r - 1.0).abs() < 0.02, "a point of the unit sphere: {r}");
        if flag == "--layers 3" {
            assert!(t[at + 1200] > t[at] + 1.9 && t[at + 2400] == f64::INFINITY);
        }
    }
}

#[test]
fn exr_has_the_contracts_channels() {
    use exr::prelude::{ReadChannels, ReadLayers, read};
    let p = Place::new();
    p.good(&format!(
        "render {SPHERE} --method march/cpu --isovalue 1 --size 40x30 -o a.exr"
    ));
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(p.path("a.exr"))
        .expect("EXR");
    let channels = &image.layer_data.channel_data.list;
    let mut names: Vec<String> = channels.iter().map(|c| c.name.to_string()).collect();
    names.sort();
    assert_eq!(names, ["A", "B", "G", "N.X", "N.Y", "N.Z", "R", "Z"]);
    let value = |name: &str, i: usize| {
        let c = channels.iter().find(|c| c.name.to_string() == name).expect(name);
        c.sample_data.value_by_flat_index(i).to_f32()
    };
    let at = 15 * 40 + 20;
    assert_eq!((value("Z", 0), value("A", 0)), (f32::INFINITY, 0.0));
    assert!(value("Z", at) > 1.0 && value("A", at) == 1.0);
    let n = ["N.X", "N.Y", "N.Z"].map(|c| value(c, at));
    assert!((n.iter().map(|v| v * v).sum::<f32>() - 1.0).abs() < 1e-5);
}

#[test]
fn an_isovalue_outside_the_range_gives_an_empty_image_and_a_warning() {
    let p = Place::new();
    let o = p.run(&format!(
        "render {SPHERE} --method march/cpu --isovalue 100 --size 20x10 -o a.png"
    ));
    assert_eq!(o.status.code(), Some(0));
    assert!(text(&o.stderr).contains("warning") && text(&o.stderr).contains("--isovalue 100"));
    let picture = image::open(p.path("a.png")).expect("PNG").to_rgb8();
    assert!(picture.pixels().all(|c| c.0 == [255; 3]));
}

#[test]
fn a_mesh_hides_what_is_behind() {
    let p = Place::new();
    // A wide rectangle at z = 0.9, above most of the sphere.
    let off = p.file(
        "wall.off",
        b"OFF\n4 2 0\n-9 -9 0.9\n9 -9 0.9\n9 9 0.9\n-9 9 0.9\n3 0 1 2\n3 0 2 3\n",
    );
    p.good(&format!(
        "render {SPHERE} --method march/cpu --isovalue 1 --size 21x21 --view +z --mesh {off} -o a.npz"
    ));
    let got = arrays(&p.path("a.npz"));
    let surface = &got.iter().find(|a| a.0 == "surface.npy").expect("surface").3;
    assert_eq!(surface[10 * 21 + 10], 0.0, "the sphere's cap sticks out");
    assert_eq!(surface[10 * 21 + 4], 1.0, "the wall hides the rest");
}

#[test]
fn check_counts_every_pixel() {
    let p = Place::new();
    let t = p.good(&format!(
        "check {SPHERE} --method march/cpu --isovalue 1 --size 32x24 --json c.json --map m.png"
    ));
    assert!(t.contains("missed") && t.contains("undecidable"), "{t}");
    let j = json(&p.path("c.json"));
    let keys: Vec<&String> = j.as_object().expect("an object").keys().collect();
    for key in [
        "pixels",
        "hits",
        "missed",
        "false",
        "wrong_root",
        "wrong_surface",
        "refuted",
        "undecidable",
        "unclaimed",
        "t_error_voxels",
        "normal_error_deg",
        "stage",
    ] {
        assert!(keys.iter().any(|k| *k == key), "{key} is not in {keys:?}");
    }
    assert_eq!(j["pixels"], 32 * 24);
    assert_eq!(j["refuted"], 0);
    for key in ["median", "p99", "max"] {
        assert!(j["t_error_voxels"][key].as_f64().expect(key) < 0.5);
        assert!(j["normal_error_deg"][key].is_number());
    }
    let stages: u64 = ["f64", "dd", "exact"]
        .iter()
        .map(|k| j["stage"][k].as_u64().expect("a count"))
        .sum();
    assert!(stages > 0);
    assert_eq!(image::open(p.path("m.png")).expect("PNG").width(), 32);
    // The truth is kept and used again: the same answer.
    assert!(std::fs::read_dir(p.path("cache")).expect("the cache").count() > 0);
    p.good(&format!(
        "check {SPHERE} --method march/cpu --isovalue 1 --size 32x24 --json d.json"
    ));
    assert_eq!(json(&p.path("c.json")), json(&p.path("d.json")));
}

/// A transfer function adds the colours: every method against the integral, peaks/* also against exact peaks.
#[test]
fn check_holds_colours_against_the_exact_ones() {
    let p = Place::new();
    let tf = p.file(
        "t.toml",
        b"points = [[0.5, 1.0, 0.5, 0.1, 0.0], [1.0, 1.0, 0.5, 0.1, 0.05], [1.5, 0.1, 0.5, 1.0, 0.0]]",
    );
    let t = p.good(&format!(
        "check {SPHERE} --method peaks/cpu --tf {tf} --size 32x24 --strict --json c.json"
    ));
    assert!(t.contains("colour, peaks") && t.contains("colour, bias"), "{t}");
    let j = json(&p.path("c.json"));
    assert_eq!(
        (&j["missed"], &j["false"], &j["isovalues"][0]),
        (&0.into(), &0.into(), &1.0.into())
    );
    let max = |of: &str| j["colour"][of]["max"].as_f64().expect(of);
    // Seen: 7e-4 and 9e-3 in another view.
    assert!(max("peaks") < 2e-3 && max("bias") > 3e-3, "{j}");
    assert!((max("integral") - max("bias")).abs() < 2e-3, "{j}");
    assert!(j["colour"]["error_bound"].as_f64().expect("a bound") < 1e-6);

    let t = p.good(&format!(
        "check synthetic:sphere,n=12,as=tets --method cellproj/cpu --set integration=exact --isovalue 1 --tf {tf} --size 32x24 --strict --json d.json"
    ));
    assert!(t.contains("colour, integral") && !t.contains("colour, peaks"), "{t}");
    let j = json(&p.path("d.json"));
    assert!(j["colour"]["integral"]["max"].as_f64().expect("a number") < 1e-5, "{j}");
    p.bad(
        &format!("check {SPHERE} --method peaks/cpu --tf none.toml --size 8x8"),
        "none.toml",
    );
}

#[test]
fn check_draws_random_rays_by_seed() {
    let p = Place::new();
    let run = |seed: u32, out: &str| {
        p.good(&format!(
            "check {SPHERE} --method march/cpu --isovalue 1 --rays 1500 --seed {seed} --json {out}"
        ));
        json(&p.path(out))
    };
    let (a, b, c) = (run(1, "a.json"), run(1, "b.json"), run(2, "c.json"));
    assert_eq!(a, b);
    assert_ne!(a, c);
    assert!(a["pixels"].as_u64().expect("pixels") >= 1500 && a["hits"].as_u64().expect("hits") > 0);
    // Whole rows of views of the size asked for: 1500 rays are 10 views of 12 x 12 and one of 12 x 5.
    p.good(&format!(
        "check {SPHERE} --method march/cpu --isovalue 1 --rays 1500 --size 12x12 --json d.json"
    ));
    assert_eq!(json(&p.path("d.json"))["pixels"].as_u64(), Some(10 * 144 + 5 * 12));
}

#[test]
fn a_strict_check_answers_no() {
    let p = Place::new();
    // Steps of many voxels miss most of the surface.
    let line = "check synthetic:gyroid,n=48 --method march/cpu --isovalue 0.2 --set step=2 --size 64x48";
    assert_eq!(p.run(line).status.code(), Some(0), "without claims nothing is refuted");
    let strict = p.run(&format!("{line} --strict"));
    assert_eq!(strict.status.code(), Some(1), "{}", text(&strict.stdout));
}

#[test]
fn compare_ranks_and_writes_a_page() {
    let p = Place::new();
    let t = p.good(&format!(
        "compare {SPHERE} --isovalue 1 --max-error 0.01 --size 32x24 --repeat 2 --methods march/cpu,mc/cpu -o out"
    ));
    assert!(t.contains("march/cpu") && t.contains("mc/cpu"), "{t}");
    let page = std::fs::read_to_string(p.path("out/index.html")).expect("index.html");
    assert!(page.contains("data:image/png;base64,") && page.contains("march/cpu"));
    assert!(
        !page.contains("http://") && !page.contains("https://"),
        "the page needs no network"
    );
    let mut table = csv::Reader::from_path(p.path("out/table.csv")).expect("table.csv");
    let rows: Vec<csv::StringRecord> = table.records().map(|r| r.expect("a row")).collect();
    assert!(rows.len() > 2, "a sweep has several rows");
    assert_eq!(p.names(), ["out"]);
    // A second run into the same folder replaces it.
    p.good(&format!(
        "compare {SPHERE} --isovalue 1 --size 32x24 --repeat 1 --methods march/cpu -o out"
    ));
    assert_eq!(p.names(), ["out"]);
}

#[test]
fn help_is_everywhere() {
    let p = Place::new();
    assert!(p.good("--help").contains("compare"));
    for verb in ["methods", "info", "render", "check", "compare"] {
        assert!(p.good(&format!("{verb} --help")).contains("Usage: isobar"), "{verb}");
    }
    assert!(p.good("--version").starts_with("isobar "));
}
