//! Pieces of HTML text: escaping, tables, numbers as people read them.

use std::fmt::Write;

/// Text with the characters of markup escaped.
#[must_use]
pub(super) fn escape(s: &str) -> String {
    let mut out = String::with_capacity(s.len());
    for c in s.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c => out.push(c),
        }
    }
    out
}

/// An anchor made of a name.
#[must_use]
pub(super) fn anchor(s: &str) -> String {
    s.chars()
        .map(|c| {
            if c.is_ascii_alphanumeric() {
                c.to_ascii_lowercase()
            } else {
                '-'
            }
        })
        .collect()
}

/// Paragraphs of plain text; blank lines part them.
#[must_use]
pub(super) fn paragraphs(s: &str) -> String {
    let parts = s.split("\n\n").map(str::trim).filter(|p| !p.is_empty());
    parts.fold(String::new(), |mut out, p| {
        let _ = writeln!(out, "<p>{}</p>", escape(p));
        out
    })
}

/// A count with narrow spaces between thousands.
#[must_use]
pub(super) fn count(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push('\u{202f}');
        }
        out.push(c);
    }
    out
}

/// Three significant digits: `0.00123`, `12.3`, `1230`, `4.5e-9`; 0 is `0`.
#[must_use]
pub(super) fn number(x: f64) -> String {
    if x == 0.0 {
        return "0".into();
    }
    if !x.is_finite() {
        return "–".into();
    }
    let exponent = x.abs().log10().floor() as i32;
    if !(-3..6).contains(&exponent) {
        return format!("{x:.1e}");
    }
    let decimals = (2 - exponent).max(0) as usize;
    format!("{x:.decimals$}")
}

/// Seconds as milliseconds.
#[must_use]
pub(super) fn ms(seconds: f64) -> String {
    number(seconds * 1e3)
}

/// Bytes with a binary unit.
#[must_use]
pub(crate) fn bytes(n: u64) -> String {
    let units = ["B", "KiB", "MiB", "GiB"];
    let mut x = n as f64;
    let mut unit = 0;
    while x >= 1024.0 && unit + 1 < units.len() {
        x /= 1024.0;
        unit += 1;
    }
    if unit == 0 {
        format!("{n} B")
    } else {
        format!("{} {}", number(x), units[unit])
    }
}

/// A cell of a table.
#[derive(Debug, Clone)]
pub(super) struct Cell {
    class: &'static str,
    html: String,
}

impl Cell {
    /// A number or short mark, aligned right; `html` is markup.
    #[must_use]
    pub(super) fn new(html: impl Into<String>) -> Self {
        Self {
            class: "",
            html: html.into(),
        }
    }

    /// Text, aligned left; escaped.
    #[must_use]
    pub(super) fn text(s: &str) -> Self {
        Self {
            class: "text",
            html: escape(s),
        }
    }

    /// Markup with a class.
    #[must_use]
    pub(super) fn with(class: &'static str, html: impl Into<String>) -> Self {
        Self {
            class,
            html: html.into(),
        }
    }

    /// A count: grey where it is 0, red where `bad` and not 0.
    #[must_use]
    pub(super) fn count(n: u64, bad: bool) -> Self {
        let class = match (n, bad) {
            (0, _) => "zero",
            (_, true) => "bad",
            _ => "",
        };
        Self::with(class, count(n))
    }
}

/// A table that scrolls sideways on narrow screens. `head`: class and markup of each column's title. `rows`: class of the row, cells.
#[must_use]
pub(super) fn table(head: &[(&str, &str)], rows: &[(&str, Vec<Cell>)]) -> String {
    let mut out = String::from("<div class=\"scroll\"><table><thead><tr>");
    for (class, title) in head {
        let _ = write!(out, "<th class=\"{class}\">{title}</th>");
    }
    out.push_str("</tr></thead><tbody>\n");
    for (class, cells) in rows {
        let _ = write!(out, "<tr class=\"{class}\">");
        // The last cell of a short row takes the columns that are left.
        for (i, c) in cells.iter().enumerate() {
            let span = if i + 1 == cells.len() && cells.len() < head.len() {
                format!(" colspan=\"{}\"", head.len() - i)
            } else {
                String::new()
            };
            let _ = write!(out, "<td class=\"{}\"{span}>{}</td>", c.class, c.html);
        }
        out.push_str("</tr>\n");
    }
    out.push_str("</tbody></table></div>\n");
    out
}

/// A figure with a caption; both are markup.
#[must_use]
pub(super) fn figure(body: &str, caption: &str) -> String {
    format!("<figure>{body}<figcaption>{caption}</figcaption></figure>\n")
}

/// An image file relative to the page, that opens in full.
#[must_use]
pub(super) fn image(path: &str, alt: &str, size: [usize; 2]) -> String {
    format!(
        "<a href=\"{p}\"><img src=\"{p}\" alt=\"{}\" width=\"{}\" height=\"{}\" loading=\"lazy\"></a>",
        escape(alt),
        size[0],
        size[1],
        p = escape(path)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        assert_eq!(
            [
                number(0.0),
                number(12.345),
                number(1234.5),
                number(0.001_234),
                number(4.56e-9)
            ],
            ["0", "12.3", "1234", "0.00123", "4.6e-9"]
        );
        assert_eq!(count(1_234_567), "1\u{202f}234\u{202f}567");
        assert_eq!([bytes(12), bytes(2048), bytes(3 << 20)], ["12 B", "2.00 KiB", "3.00 MiB"]);
        assert_eq!(ms(0.0123), "12.3");
    }

    #[test]
    fn text_is_escaped() {
        assert_eq!(escape("a<b & \"c\""), "a&lt;b &amp; &quot;c&quot;");
        assert!(paragraphs("a<b\n\nc").contains("<p>a&lt;b</p>\n<p>c</p>"));
        let t = table(&[("text", "x"), ("", "y")], &[("", vec![Cell::text("<i>")])]);
        assert!(t.contains("colspan=\"2\">&lt;i&gt;"));
    }
}
