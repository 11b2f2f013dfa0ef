//! The command line: flags, help, and how an answer or an error leaves the process.

use crate::interrupt;
use crate::verbs;
use crate::view_spec::ViewFlags;
use anyhow::Result;
use clap::error::ErrorKind;
use clap::{Args, CommandFactory, FromArgMatches, Parser, Subcommand};
use std::ffi::OsString;
use std::io::Write;
use std::path::PathBuf;

/// A barometer for isosurface renderers: how fast each one is, how wrong, and where it breaks.
#[derive(Debug, Parser)]
#[command(
    name = "isobar",
    version,
    disable_help_subcommand = true,
    after_help = "DATA is a file (NRRD, NIfTI, VTI, legacy VTK, Open SciVis raw; meshes and elements) or synthetic:NAME[,n=64]\n\
                  [,as=grid|algebraic|tets|hexes][,key=value...], such as synthetic:gyroid,n=128. FILE,as=hexes reads hexahedra, PLOT3D and grids as elements.\n\
                  Exit status: 0 done, 1 answered no (check, compare), 2 unusable input or arguments, 130 interrupted.\n\
                  Certified truth is kept under $ISOBAR_CACHE, else target/isobar-truth of the workspace, else the user's cache folder."
)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub verb: Verb,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Verb {
    /// List every method: whether it can start here, what it draws, its knobs
    Methods(MethodsArgs),
    /// Describe data: geometry, fields, range, histogram, suggested isovalues
    Info(InfoArgs),
    /// Draw isosurfaces with one method
    Render(Box<RenderArgs>),
    /// Compare every pixel of a method with the certified truth
    Check(Box<CheckArgs>),
    /// Draw with every method that can, side by side, and rank them at equal error
    Compare(Box<CompareArgs>),
}

/// Flags of `methods`.
#[derive(Debug, Clone, Args)]
pub struct MethodsArgs {
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// Which data.
#[derive(Debug, Clone, Args)]
pub struct DataFlags {
    /// A file (FILE,as=hexes: hexahedra and grids as elements), or synthetic:NAME with keys such as n=64 and as=grid, algebraic, tets or hexes, separated by commas
    #[arg(value_name = "DATA")]
    pub data: String,
    /// Which field of the file to read [default: the first scalar]
    #[arg(long, value_name = "NAME")]
    pub field: Option<String>,
    /// Read NaN and infinite samples as this number
    #[arg(long, value_name = "C", allow_hyphen_values = true)]
    pub nan: Option<String>,
    /// Average a field of the cells of a mesh to its points
    #[arg(long)]
    pub cell_to_point: bool,
}

/// Flags of `info`.
#[derive(Debug, Clone, Args)]
pub struct InfoArgs {
    /// The data.
    #[command(flatten)]
    pub data: DataFlags,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// How to draw.
#[derive(Debug, Clone, Args)]
pub struct DrawFlags {
    /// Settings of the method; see isobar methods
    #[arg(long, value_name = "KNOB=VALUE[,...]", allow_hyphen_values = true)]
    pub set: Vec<String>,
    /// Worker threads [default: all]
    #[arg(
        long,
        value_name = "N",
        default_value_t = 0,
        hide_default_value = true,
        allow_hyphen_values = true
    )]
    pub threads: usize,
}

/// Surfaces of elements that are no isosurfaces; they come after the isovalues in the order of the frame's surface index.
#[derive(Debug, Clone, Default, Args)]
pub struct MoreSurfaces {
    /// Where a parameter of each element has a value from 0 to 1, with opacity and colour if wanted (nurbs/cpu)
    #[arg(long, value_name = "u|v|w=VALUE[:OPACITY[:#RRGGBB]][,...]")]
    pub parameter: Vec<String>,
    /// The boundary of the domain: faces of one element only, with opacity and colour if wanted (nurbs/cpu)
    #[arg(
        long,
        value_name = "OPACITY[:#RRGGBB]",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = "1"
    )]
    pub boundary: Option<String>,
}

/// Flags of `render`.
#[derive(Debug, Clone, Args)]
pub struct RenderArgs {
    /// The data.
    #[command(flatten)]
    pub data: DataFlags,
    /// Which method draws; see isobar methods
    #[arg(long, value_name = "ID")]
    pub method: String,
    /// Isovalues in data units, each with opacity (0 to 1) and sRGB colour if wanted
    #[arg(
        long,
        value_name = "C[:OPACITY[:#RRGGBB]][,...]",
        allow_hyphen_values = true,
        required_unless_present_any = ["tf", "parameter", "boundary"]
    )]
    pub isovalue: Vec<String>,
    /// Other surfaces of elements.
    #[command(flatten)]
    pub more: MoreSurfaces,
    /// Threads and knobs.
    #[command(flatten)]
    pub draw: DrawFlags,
    /// The view.
    #[command(flatten)]
    pub view: ViewFlags,
    /// Keep this many hits per pixel, front to back; even 1 gives the npz arrays a leading axis
    #[arg(help_heading = "Scene", long, value_name = "N", allow_hyphen_values = true)]
    pub layers: Option<usize>,
    /// Transfer function between the surfaces: TOML with points = [[value, r, g, b, density], ...] and unit
    #[arg(help_heading = "Scene", long, value_name = "FILE")]
    pub tf: Option<PathBuf>,
    /// An opaque triangle mesh in the same world, joined by distance; its surface index is the number of surfaces (isovalues, parameters, boundary)
    #[arg(help_heading = "Scene", long, value_name = "FILE.off|.ply")]
    pub mesh: Option<PathBuf>,
    /// Write the image; may be repeated. png: sRGB over white; exr: linear colour, t, normals; npz: every channel
    #[arg(help_heading = "Output", short = 'o', long = "output", value_name = "OUT.png|.exr|.npz")]
    pub output: Vec<PathBuf>,
    /// Write times, memory, counters and settings as JSON
    #[arg(help_heading = "Output", long, value_name = "FILE")]
    pub stats: Option<PathBuf>,
    /// Render this often and report the median; above 1 an untimed rendering comes first, and all frames must be equal
    #[arg(
        help_heading = "Output",
        long,
        value_name = "N",
        default_value_t = 1,
        allow_hyphen_values = true
    )]
    pub repeat: usize,
}

/// Flags of `check`.
#[derive(Debug, Clone, Args)]
pub struct CheckArgs {
    /// The data.
    #[command(flatten)]
    pub data: DataFlags,
    /// Which method to check
    #[arg(long, value_name = "ID")]
    pub method: String,
    /// Isovalues in data units
    #[arg(long, value_name = "C[,...]", allow_hyphen_values = true, required_unless_present_any = ["tf", "parameter", "boundary"])]
    pub isovalue: Vec<String>,
    /// Other surfaces of elements.
    #[command(flatten)]
    pub more: MoreSurfaces,
    /// Threads and knobs.
    #[command(flatten)]
    pub draw: DrawFlags,
    /// The view.
    #[command(flatten)]
    pub view: ViewFlags,
    /// Instead of the view: random perspective views, eyes outside and inside the data, until N pixels are compared
    #[arg(help_heading = "Check", long,
        value_name = "N",
        allow_hyphen_values = true,
        conflicts_with_all = ["view", "eye", "target", "up", "fov", "ortho", "clip"]
    )]
    pub rays: Option<u64>,
    /// Seed of --rays
    #[arg(
        help_heading = "Check",
        long,
        value_name = "S",
        default_value_t = 1,
        requires = "rays",
        allow_hyphen_values = true
    )]
    pub seed: u64,
    /// Answer no (exit 1) also for a missed or false hit, a wrong root or a wrong surface
    #[arg(help_heading = "Check", long)]
    pub strict: bool,
    /// Transfer function between the surfaces: colours are held against the exact integral too
    #[arg(help_heading = "Check", long, value_name = "FILE", conflicts_with = "rays")]
    pub tf: Option<PathBuf>,
    /// Write the counts as JSON; - is standard output
    #[arg(help_heading = "Check", long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Write a picture of the errors
    #[arg(help_heading = "Check", long, value_name = "FILE.png", conflicts_with = "rays")]
    pub map: Option<PathBuf>,
}

/// Flags of `compare`.
#[derive(Debug, Clone, Args)]
pub struct CompareArgs {
    /// The data.
    #[command(flatten)]
    pub data: DataFlags,
    /// Isovalues in data units, each with opacity and colour if wanted
    #[arg(
        long,
        value_name = "C[:OPACITY[:#RRGGBB]][,...]",
        allow_hyphen_values = true,
        required = true
    )]
    pub isovalue: Vec<String>,
    /// Only these methods [default: every one that can]
    #[arg(long, value_name = "A,B,...", value_delimiter = ',')]
    pub methods: Vec<String>,
    /// Sweep each method's quality knob and rank by time what stays within E voxels with no wrong pixel
    #[arg(long, value_name = "E", allow_hyphen_values = true)]
    pub max_error: Option<String>,
    /// Threads and knobs; a knob goes to the methods that have it.
    #[command(flatten)]
    pub draw: DrawFlags,
    /// The view.
    #[command(flatten)]
    pub view: ViewFlags,
    /// Timed renderings of each method and setting, interleaved
    #[arg(
        help_heading = "Output",
        long,
        value_name = "N",
        default_value_t = 5,
        allow_hyphen_values = true
    )]
    pub repeat: usize,
    /// Folder for index.html, table.csv and the pictures
    #[arg(help_heading = "Output", short = 'o', long = "output", value_name = "DIR")]
    pub output: PathBuf,
}

/// What a verb answers.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Answer {
    /// For standard output.
    pub text: String,
    /// Lines for standard error that do not change the exit status.
    pub warnings: Vec<String>,
    /// The answer is no: exit 1.
    pub no: bool,
}

/// Parsed arguments, or a text to print (help, version).
#[derive(Debug)]
pub enum Parsed {
    /// A verb.
    Verb(Box<Verb>),
    /// Help or version.
    Text(String),
}

/// Reads the arguments, the program's name first.
///
/// # Errors
/// When they cannot be used: one line that names the argument, the reason and where help is.
pub fn parse(arguments: impl IntoIterator<Item = OsString>) -> Result<Parsed> {
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    let verb = arguments.get(1).and_then(|a| a.to_str()).unwrap_or_default().to_owned();
    let matches = match Cli::command().try_get_matches_from(arguments) {
        Ok(m) => m,
        Err(e) if matches!(e.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) => {
            return Ok(Parsed::Text(e.to_string()));
        }
        Err(e) => anyhow::bail!("{}", reduce(&e, &verb)),
    };
    let mut cli = Cli::from_arg_matches(&matches).map_err(|e| anyhow::anyhow!("{}", reduce(&e, &verb)))?;
    if let Some((_, of_verb)) = matches.subcommand() {
        match &mut cli.verb {
            Verb::Render(a) => a.view.place_caps(of_verb),
            Verb::Check(a) => a.view.place_caps(of_verb),
            Verb::Compare(a) => a.view.place_caps(of_verb),
            Verb::Methods(_) | Verb::Info(_) => {}
        }
    }
    Ok(Parsed::Verb(Box::new(cli.verb)))
}

/// A parser's error in one line; `word` is the first argument, which should be the verb.
fn reduce(e: &clap::Error, word: &str) -> String {
    if matches!(
        e.kind(),
        ErrorKind::MissingSubcommand | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand
    ) {
        return "no verb given; use one of methods, info, render, check, compare (isobar --help)".into();
    }
    let text = e.to_string();
    let said: Vec<&str> = text
        .lines()
        .take_while(|l| !l.starts_with("Usage:") && !l.starts_with("For more information"))
        .map(str::trim)
        .filter(|l| !l.is_empty() && !l.starts_with("tip: to pass"))
        .collect();
    let said = said.join(" ").replace(" tip: ", "; ");
    let said = said.strip_prefix("error: ").unwrap_or(&said);
    let verb = match Cli::command().find_subcommand(word) {
        Some(verb) => format!(" {}", verb.get_name()),
        None => String::new(),
    };
    format!("{said}; see isobar{verb} --help")
}

/// Runs the program with these arguments and returns the exit status: 0 done, 1 answered no, 2 unusable input or arguments, 130
/// interrupted.
#[must_use]
pub fn run(arguments: Vec<OsString>) -> u8 {
    let command: Vec<String> = arguments.iter().map(|a| a.to_string_lossy().into_owned()).collect();
    let answer = parse(arguments).and_then(|parsed| match parsed {
        Parsed::Text(text) => Ok(Answer {
            text,
            ..Answer::default()
        }),
        Parsed::Verb(verb) => match *verb {
            Verb::Methods(a) => verbs::methods::run(&a),
            Verb::Info(a) => verbs::info::run(&a),
            Verb::Render(a) => verbs::render::run(&a, &command),
            Verb::Check(a) => verbs::check::run(&a),
            Verb::Compare(a) => verbs::compare::run(&a, &command),
        },
    });
    match answer.and_then(|a| say(&a.text).map(|()| a)) {
        Ok(a) => {
            for w in &a.warnings {
                complain(&format!("warning: {w}"));
            }
            u8::from(a.no)
        }
        // Whatever the work said when it was stopped.
        Err(_) if interrupt::is_asked() => {
            interrupt::tell();
            interrupt::STATUS
        }
        Err(e) => {
            complain(&format!("{e:#}"));
            2
        }
    }
}

/// Writes to standard output. A reader that went away is no error.
fn say(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(anyhow::anyhow!("standard output: {e}; send it somewhere that can be written"))
        }
        _ => Ok(()),
    }
}

/// One line on standard error, whatever the text.
pub(crate) fn complain(text: &str) {
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    // Nothing can be said if even this fails.
    let _ = writeln!(std::io::stderr().lock(), "isobar: {line}");
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(args: &[&str]) -> Result<Parsed> {
        parse(std::iter::once("isobar").chain(args.iter().copied()).map(OsString::from))
    }

    #[test]
    fn the_definition_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn the_contracts_lines_are_read() {
        for l in [
            "methods --json",
            "info a.nrrd --json",
            "render a.nrrd --method octree/cpu --isovalue -1.5:0.5:#ff0000,2 --set a=1,b=x --size 640x480 --view -x --fov 30 --layers 2 \
             --threads 1 --field f --tf t.toml --clip -1,0,0,0.5 --cap --mesh m.off --nan -1 -o a.png -o b.exr -o c.npz --stats s.json",
            "render a --method m --isovalue 1 --eye -1,2,3 --target 0,0,0 --up 0,0,1 --ortho 2",
            "render a --method m --tf t.toml",
            "render a.vtu,as=hexes --method nurbs/cpu --parameter u=0.5,w=1:0.5 --boundary -o a.png",
            "check a --method nurbs/cpu --boundary=0.25:#ffffff --strict",
            "check a --method m --isovalue 1 --view bench --strict --json out.json",
            "check a --method m --isovalue 1 --rays 1000 --seed 7",
            "compare a --isovalue 0.5 --methods a,b --max-error 0.01 -o dir",
        ] {
            let words: Vec<&str> = l.split_whitespace().collect();
            assert!(matches!(line(&words), Ok(Parsed::Verb(_))), "{l}: {:?}", line(&words));
        }
    }

    #[test]
    fn caps_belong_to_the_clip_before() {
        let l = "render a --method m --isovalue 1 --clip 1,0,0,0 --clip 0,1,0,0 --cap --clip 0,0,1,0";
        let Ok(Parsed::Verb(verb)) = line(&l.split(' ').collect::<Vec<_>>()) else {
            panic!("{l}")
        };
        let Verb::Render(a) = *verb else { panic!("{l}") };
        let v = a.view.view((glam::DVec3::NEG_ONE, glam::DVec3::ONE)).unwrap();
        assert_eq!(v.clips.iter().map(|c| c.cap).collect::<Vec<_>>(), [false, true, false]);
        let Ok(Parsed::Verb(verb)) = line(&[
            "render",
            "a",
            "--method",
            "m",
            "--isovalue",
            "1",
            "--cap",
            "--clip",
            "1,0,0,0",
        ]) else {
            panic!("cap before clip")
        };
        let Verb::Render(a) = *verb else { panic!("render") };
        assert!(a.view.validate().unwrap_err().to_string().starts_with("--cap"));
    }

    #[test]
    fn errors_are_one_line_with_a_remedy() {
        for (args, names) in [
            (vec![], "verb"),
            (vec!["draw"], "draw"),
            (vec!["render", "a"], "--method"),
            (
                vec!["render", "a", "--method", "m", "--isovalue", "1", "--colour"],
                "--colour",
            ),
            (
                vec!["render", "a", "--method", "m", "--isovalue", "1", "--threads", "-1"],
                "--threads",
            ),
            (
                vec![
                    "render",
                    "a",
                    "--method",
                    "m",
                    "--isovalue",
                    "1",
                    "--view",
                    "+x",
                    "--eye",
                    "1,2,3",
                ],
                "--view",
            ),
            (vec!["compare", "a", "--isovalue", "1"], "--output"),
        ] {
            let e = line(&args).unwrap_err().to_string();
            assert!(
                !e.contains('\n') && e.contains(names) && e.contains("isobar"),
                "{args:?}: {e}"
            );
        }
        let e = line(&["check", "a", "--method", "m", "--isovalue", "1", "--rays", "x"])
            .unwrap_err()
            .to_string();
        assert!(e.ends_with("see isobar check --help"), "{e}");
        assert!(matches!(line(&["--help"]), Ok(Parsed::Text(t)) if t.contains("compare")));
        assert!(matches!(line(&["check", "--help"]), Ok(Parsed::Text(t)) if t.contains("--strict")));
        assert!(matches!(line(&["--version"]), Ok(Parsed::Text(_))));
    }
}
