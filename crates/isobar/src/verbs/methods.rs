//! `isobar methods`: every method, whether it can start here and why not, data kinds, knobs.

use crate::cli::{Answer, MethodsArgs};
use crate::settings::{knob_json, pretty, short};
use anyhow::Result;
use isobar_core::{KnobKind, KnobSpec, Method, MethodInfo, RenderError, Request, Unsupported};
use serde_json::{Value, json};
use std::fmt::Write;

/// Lists the methods.
///
/// # Errors
/// Never; the signature is that of a verb.
pub fn run(args: &MethodsArgs) -> Result<Answer> {
    let methods = crate::methods();
    let text = if args.json {
        pretty(&Value::Array(methods.iter().map(|m| to_json(*m)).collect()))
    } else {
        methods.iter().map(|m| to_text(*m)).collect()
    };
    Ok(Answer {
        text,
        ..Answer::default()
    })
}

/// Starts a renderer and drops it: `None` where that works, else why not.
#[must_use]
pub fn cannot_start(method: &dyn Method) -> Option<String> {
    match method.open(&Request::default()) {
        Ok(_) => None,
        Err(RenderError::Unsupported(Unsupported::Machine { reason, .. })) => Some(reason),
        Err(e) => Some(e.to_string()),
    }
}

fn to_json(method: &dyn Method) -> Value {
    let MethodInfo {
        id,
        summary,
        paper,
        data,
        hits,
        gpu,
        work_unit,
        knobs,
        sweep,
    } = method.info();
    let why_not = cannot_start(method);
    json!({
        "id": id,
        "summary": summary,
        "paper": paper,
        "starts": why_not.is_none(),
        "why_not": why_not,
        "gpu": gpu,
        "data": data.words().split(", ").collect::<Vec<_>>(),
        "hits": hits,
        "work_unit": work_unit,
        "knobs": knobs.iter().map(knob_json).collect::<Vec<_>>(),
        "sweep": {"knob": sweep.0, "values": sweep.1},
    })
}

fn range(spec: &KnobSpec) -> String {
    match spec.kind {
        KnobKind::Int { default, min, max } => format!("{default} [{min} to {max}]"),
        KnobKind::Float { default, min, max } => format!("{} [{} to {}]", short(default), short(min), short(max)),
        KnobKind::Choice(words) => words.join(" | "),
    }
}

fn to_text(method: &dyn Method) -> String {
    let info = method.info();
    let mut out = format!("{}  {}\n", info.id, info.summary);
    let mut row = |name: &str, value: &str| {
        // Writing to a String cannot fail.
        let _ = writeln!(out, "    {name:<10} {value}");
    };
    let state = cannot_start(method).map_or("can start here".to_owned(), |why| format!("cannot start here: {why}"));
    row("state", &state);
    if !info.paper.is_empty() {
        row("paper", info.paper);
    }
    row("data", &info.data.words());
    row("gives", if info.hits { "hits and colour" } else { "colour only" });
    if !info.sweep.0.is_empty() {
        row("sweep", &format!("{} = {}", info.sweep.0, info.sweep.1.join(", ")));
    }
    for k in info.knobs {
        row("knob", &format!("{} = {}: {}", k.name, range(k), k.doc));
    }
    out.push('\n');
    out
}
