//! Bad input of every kind, interruption, readers that leave.

use super::{Place, SPHERE, nan_file, text};
use std::path::Path;
use std::process::Command;

#[test]
fn bad_arguments_are_one_line() {
    let p = Place::new();
    let march = format!("render {SPHERE} --method march/cpu --isovalue 1 --size 20x10");
    for (line, names) in [
        (String::new(), "verb"),
        ("draw".into(), "draw"),
        (format!("render {SPHERE} --isovalue 1"), "--method"),
        (format!("render {SPHERE} --method march/cpu"), "--isovalue"),
        (format!("{march} --wrong"), "--wrong"),
        (format!("render {SPHERE} --method marsh/cpu --isovalue 1"), "--method"),
        (format!("render {SPHERE} --method march/cpu --isovalue nan"), "--isovalue"),
        (format!("render {SPHERE} --method march/cpu --isovalue 1:2"), "--isovalue"),
        (format!("render {SPHERE} --method march/cpu --isovalue 1:1:red"), "--isovalue"),
        (
            format!("render {SPHERE} --method march/cpu --isovalue 1 --size 0x0 -o a.png"),
            "--size",
        ),
        (
            format!("render {SPHERE} --method march/cpu --isovalue 1 --size 70000x1 -o a.png"),
            "--size",
        ),
        (
            format!("render {SPHERE} --method march/cpu --isovalue 1 --size 60000x40000 -o a.png"),
            "--size",
        ),
        (
            format!("render {SPHERE} --method march/cpu --isovalue 1 --size 16000x16000 --layers 65535 -o a.npz"),
            "--size",
        ),
        (format!("{march} --set colour=1"), "colour"),
        (format!("{march} --set step=-1"), "step"),
        (format!("{march} --set step"), "--set"),
        (format!("{march} --view front"), "--view"),
        (format!("{march} --fov 0"), "--fov"),
        (format!("{march} --ortho -1"), "--ortho"),
        (format!("{march} --eye 0,0,0 --target 0,0,0"), "--eye"),
        (format!("{march} --eye 0,0"), "--eye"),
        (format!("{march} --cap"), "--cap"),
        (format!("{march} --clip 0,0,0,0"), "--clip"),
        (format!("{march} --layers 0"), "--layers"),
        (format!("{march} --threads 1000000"), "--threads"),
        (format!("{march} --field pressure"), "--field"),
        (format!("{march} --nan x"), "--nan"),
        (format!("{march} --repeat 0"), "--repeat"),
        (format!("{march} --tf missing.toml"), "missing.toml"),
        (format!("{march} --mesh missing.off"), "missing.off"),
        (format!("{march} -o a.jpg"), "a.jpg"),
        (format!("{march} -o a.png -o a.png"), "a.png"),
        (format!("{march} -o no/such/folder/a.png"), "no/such/folder/a.png"),
        (format!("{march} -o . "), "-o ."),
        (format!("{march} --stats no/such/s.json"), "--stats"),
        (format!("{march} --clip 1,0,0,0 --mesh missing.off"), "missing.off"),
        (
            "render synthetic:sphere,n=5,as=tets --method march/cpu --isovalue 1".into(),
            "--method march/cpu",
        ),
        (
            "check synthetic:sphere,as=algebraic --method march/cpu --isovalue 1".into(),
            "--method march/cpu",
        ),
        (
            format!("check {SPHERE} --method march/cpu --isovalue 1 --clip 1,0,0,0 --cap"),
            "--cap",
        ),
        (format!("compare {SPHERE} --isovalue 1 --clip 1,0,0,0 --cap -o out"), "--cap"),
        (format!("check {SPHERE} --method march/cpu --isovalue 1 --map m.exr"), "--map"),
        (
            format!("check {SPHERE} --method march/cpu --isovalue 1 --rays 10 --view +x"),
            "--rays",
        ),
        ("info synthetic:nothing".into(), "nothing"),
        ("info synthetic:sphere,n=1000000".into(), "n=1000000"),
        (format!("check {SPHERE} --method march/cpu --isovalue 1 --rays 0"), "--rays"),
        (
            format!("check {SPHERE} --method march/cpu --isovalue 1 --json no/such/c.json"),
            "--json",
        ),
        (format!("compare {SPHERE} --isovalue 1 --max-error -1 -o out"), "--max-error"),
        (format!("compare {SPHERE} --isovalue 1 --methods none -o out"), "none"),
        (format!("compare {SPHERE} --isovalue 1 -o no/such/out"), "no/such/out"),
        (
            format!("compare {SPHERE} --isovalue 1 --methods mc/cpu,mc/cpu -o out"),
            "--methods mc/cpu: named twice",
        ),
        (format!("compare {SPHERE} --isovalue 1 -o -"), "standard output"),
        (format!("{march} --stats -"), "standard output"),
        (
            format!("render {SPHERE} --method march/cpu --isovalue 1,,2"),
            "--isovalue 1,,2",
        ),
        (format!("{march} --layers x"), "isobar render --help"),
        (format!("{march} --fov 1e-300"), "--fov 1e-300"),
        (format!("{march} -o {}.png", "n".repeat(300)), "choose another name"),
    ] {
        p.bad(&line, names);
    }
}

#[test]
fn bad_files_are_one_line() {
    let p = Place::new();
    let nan = nan_file(&p);
    let files = [
        ("missing.nrrd".to_owned(), "missing.nrrd"),
        (nan.clone(), "--nan"),
        (p.file("empty.nrrd", b""), "empty.nrrd"),
        (p.file("noise.nii", b"\0\xff\x13noise"), "noise.nii"),
        (
            p.file(
                "cut.nrrd",
                b"NRRD0004\ntype: float\ndimension: 3\nsizes: 9 9 9\nencoding: raw\nendian: little\n\nabc",
            ),
            "cut.nrrd",
        ),
        (
            p.file(
                "huge.nrrd",
                b"NRRD0004\ntype: float\ndimension: 3\nsizes: 99999999 99999999 99999999\nencoding: raw\n\n",
            ),
            "huge.nrrd",
        ),
        (
            p.file(
                "zero.nrrd",
                b"NRRD0004\ntype: float\ndimension: 3\nsizes: 0 4 4\nencoding: raw\n\n",
            ),
            "zero.nrrd",
        ),
        (p.path("").to_str().expect("UTF-8").to_owned(), ""),
    ];
    for (file, names) in &files {
        p.bad(
            &format!("render {file} --method march/cpu --isovalue 1 --size 9x9 -o a.png"),
            names,
        );
    }
    p.good(&format!(
        "render {nan} --nan 0 --method march/cpu --isovalue 12.5 --size 9x9 -o b.png"
    ));
    std::fs::remove_file(p.path("b.png")).expect("b.png");
    p.bad(
        &format!("render {nan} --nan 0 --field other --method march/cpu --isovalue 1"),
        "other",
    );
    let mesh = p.file("bad.off", b"OFF\n1 1 0\n0 0 0\n3 0 1 2\n");
    p.bad(
        &format!("render {SPHERE} --method march/cpu --isovalue 1 --mesh {mesh} -o a.png"),
        "bad.off",
    );
    for (n, medium) in [
        "points = [[0, 1, 0]]",
        "points = [[0, 1, 0, 0, 1, 7]]",
        "unit = 1e-320\npoints = [[0, 1, 0, 0, 1]]",
        "points = [[0, 1, 0, 0, 1e38], [10, 0, 1, 0, 0]]",
    ]
    .iter()
    .enumerate()
    {
        let tf = p.file(&format!("bad{n}.toml"), medium.as_bytes());
        p.bad(
            &format!("render {SPHERE} --method march/cpu --isovalue 1 --tf {tf} -o a.png"),
            &format!("--tf {tf}"),
        );
    }
    let tf = p.file("long.toml", &[b'#'; (4 << 20) + 2]);
    p.bad(&format!("render {SPHERE} --method peaks/cpu --tf {tf}"), "longer than");
}

#[cfg(unix)]
#[test]
fn a_reader_that_leaves_is_no_error_and_a_full_disk_is_one() {
    use std::process::Stdio;
    let program = || {
        let mut c = Command::new(env!("CARGO_BIN_EXE_isobar"));
        c.args(["info", SPHERE]).stderr(Stdio::piped());
        c
    };
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let o = program().stdout(writer).output().expect("the program starts");
    assert_eq!((o.status.code(), text(&o.stderr)), (Some(0), String::new()));
    let full = Path::new("/dev/full");
    if full.exists() {
        let disk = std::fs::OpenOptions::new().write(true).open(full).expect("/dev/full");
        let o = program().stdout(disk).output().expect("the program starts");
        let said = text(&o.stderr);
        assert_eq!((o.status.code(), said.lines().count()), (Some(2), 1), "{said}");
        assert!(said.contains("standard output"), "{said}");
    }
}

/// Until the process has a handler of SIGINT, where the system tells, else long enough.
#[cfg(unix)]
fn wait_until_it_listens(process: u32) {
    let caught = || {
        let status = std::fs::read_to_string(format!("/proc/{process}/status")).ok()?;
        let mask = status.lines().find_map(|l| l.strip_prefix("SigCgt:"))?;
        u64::from_str_radix(mask.trim(), 16).ok()
    };
    for _ in 0..30 {
        // SIGINT is 2, the second bit.
        if caught().is_some_and(|mask| mask & 2 != 0) {
            return;
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
}

/// One line, the status of an interrupted program, nothing written.
#[cfg(unix)]
#[test]
fn an_interrupted_run_leaves_nothing() {
    use std::process::Stdio;
    use std::time::{Duration, Instant};
    let p = Place::new();
    let before = p.names();
    for line in [
        "info synthetic:chmutov,n=700",
        "render synthetic:torus,n=150,as=tets --method cellproj/cpu --isovalue 0 --size 64x48 -o a.png",
        "render synthetic:gyroid,n=64 --method march/cpu --isovalue 0.2 --size 4000x3000 --repeat 10000 -o a.png --stats s.json",
        "compare synthetic:gyroid,n=48 --isovalue 0.2 --size 800x600 --repeat 100000 --methods march/cpu,mc/cpu -o out",
    ] {
        let child = Command::new(env!("CARGO_BIN_EXE_isobar"))
            .args(line.split_whitespace())
            .current_dir(p.dir.path())
            .env("ISOBAR_CACHE", "")
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the program starts");
        wait_until_it_listens(child.id());
        std::thread::sleep(Duration::from_millis(300));
        let asked = Instant::now();
        let sent = Command::new("kill")
            .args(["-INT", &child.id().to_string()])
            .status()
            .expect("kill");
        assert!(sent.success(), "{line} ended too early");
        let o = child.wait_with_output().expect("it ends");
        assert!(asked.elapsed() < Duration::from_secs(3), "{line}: {:?}", asked.elapsed());
        assert_eq!(
            (o.status.code(), text(&o.stderr)),
            (Some(130), "isobar: interrupted\n".into()),
            "{line}"
        );
        assert_eq!((text(&o.stdout), p.names()), (String::new(), before.clone()), "{line}");
    }
}
