//! MicroSIG's particle data file: one particle per row, the same number of columns in every row.
//!
//! | columns | content |
//! |---|---|
//! | 4 | x y z d_p |
//! | 5 | x y z d_p c_int |
//! | 7 | x y z d_p e_p alpha beta |
//! | 8 | x y z d_p e_p alpha beta c_int |
//!
//! x, y in px; z, d_p in um; angles in rad. Separators are white space, commas or semicolons, one style per
//! file. `#` and `%` start comments; blank lines are skipped; a file without rows gives an image of the
//! background.

use std::io::{BufRead, BufReader, Read, Write};

use crate::error::Error;
use crate::formats::{number, text_line};
use crate::particle::{Particle, Spheroid};
use crate::problem::{Problem, Problems};

/// The columns of a data file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    /// Whether there are columns e_p, alpha and beta.
    pub spheroids: bool,
    /// Whether there is a column c_int.
    pub c_int: bool,
}

impl Layout {
    /// The layout with the fewest columns that represents these particles without loss.
    pub fn of(particles: &[Particle]) -> Self {
        Layout {
            spheroids: particles.iter().any(|p| p.spheroid.is_some()),
            c_int: particles.iter().any(|p| p.c_int != 1.0),
        }
    }

    fn from_columns(columns: usize) -> Option<Self> {
        match columns {
            4 | 5 => Some(Layout { spheroids: false, c_int: columns == 5 }),
            7 | 8 => Some(Layout { spheroids: true, c_int: columns == 8 }),
            _ => None,
        }
    }

    fn columns(self) -> usize {
        4 + 3 * usize::from(self.spheroids) + usize::from(self.c_int)
    }
}

/// Number of problems after which reading stops.
const MAX_PROBLEMS: usize = 20;

#[derive(Clone, Copy, PartialEq)]
enum Separator {
    WhiteSpace,
    Comma,
    Semicolon,
}

impl Separator {
    /// Commas are separators only if no token between them contains white space: `1,5 2,5` is white space
    /// with decimal commas, `1, 5, 2` is commas.
    fn of(line: &str) -> Self {
        let tight =
            |c| line.split(c).all(|t: &str| !t.trim().is_empty() && !t.trim().contains(char::is_whitespace));
        if line.contains(';') {
            Separator::Semicolon
        } else if line.contains(',') && tight(',') {
            Separator::Comma
        } else {
            Separator::WhiteSpace
        }
    }

    fn split<'a>(self, line: &'a str, tokens: &mut Vec<&'a str>) {
        tokens.clear();
        match self {
            Separator::WhiteSpace => tokens.extend(line.split_ascii_whitespace()),
            Separator::Comma => tokens.extend(line.split(',').map(str::trim)),
            Separator::Semicolon => tokens.extend(line.split(';').map(str::trim)),
        }
    }
}

/// Reads the particles of one image; `name` is the name of the file in messages. Errors: [`Error::Malformed`]
/// with file, line and column for rows of different lengths, 1-3, 6 or more than 8 columns, non-numeric or
/// non-finite values, d_p <= 0, e_p <= 0, c_int < 0, decimal commas, text that is not UTF-8 and lines that
/// end in CR alone; [`Error::Io`] if reading fails.
pub fn read(reader: impl Read, name: &str) -> Result<Vec<Particle>, Error> {
    let mut reader = BufReader::new(reader);
    let (mut particles, mut problems) = (Vec::new(), Problems::default());
    let mut style: Option<(Separator, Layout)> = None;
    let mut line = Vec::new();
    let mut number = 0;
    while problems.0.len() < MAX_PROBLEMS {
        line.clear();
        if reader.read_until(b'\n', &mut line).map_err(|e| Error::io(name, e))? == 0 {
            break;
        }
        number += 1;
        let text = match text_line::text_of(&line) {
            Ok(text) => text,
            Err(message) => {
                problems.push(Problem::other("", message).within(format!("{name}:{number}")));
                continue;
            }
        };
        let content = text.split(['#', '%']).next().unwrap_or_default();
        let content =
            if number == 1 { content.trim_start_matches('\u{feff}').trim() } else { content.trim() };
        if content.is_empty() {
            continue;
        }
        match row(content, &mut style) {
            Ok(particle) => particles.push(particle),
            Err((column, problem)) => {
                let column = column.map(|column| format!(", column {column}")).unwrap_or_default();
                problems.push(problem.within(format!("{name}:{number}{column}")));
            }
        }
    }
    problems.finish(Error::Malformed).map(|()| particles)
}

/// The line, from 1, of particle number `index`, from 0, of a data file that [`read`] accepts.
pub fn line_of(bytes: &[u8], index: usize) -> Option<usize> {
    let is_row = |line: &[u8]| {
        let content = line.split(|byte| b"#%".contains(byte)).next().unwrap_or_default();
        let content = content.strip_prefix(b"\xef\xbb\xbf").unwrap_or(content);
        !content.trim_ascii().is_empty()
    };
    bytes
        .split(|byte| *byte == b'\n')
        .enumerate()
        .filter(|(_, line)| is_row(line))
        .nth(index)
        .map(|(n, _)| n + 1)
}

/// Parses one row; the first row determines separator and layout. The error is a column, counted from 1, and
/// its problem.
fn row(content: &str, style: &mut Option<(Separator, Layout)>) -> Result<Particle, (Option<usize>, Problem)> {
    let separator = style.map_or_else(|| Separator::of(content), |(separator, _)| separator);
    let mut tokens = Vec::with_capacity(8);
    separator.split(content, &mut tokens);
    if separator != Separator::Comma
        && let Some(i) = tokens.iter().position(|t| t.contains(','))
    {
        let message = format!("`{}`: a decimal comma? expected a decimal point", tokens[i]);
        return Err((Some(i + 1), Problem::other("", message)));
    }
    let layout = match style {
        Some((_, layout)) if layout.columns() == tokens.len() => *layout,
        Some((_, layout)) => {
            let (now, before) = (tokens.len(), layout.columns());
            let message = format!("{now} columns, but {before} before: rows must agree");
            return Err((None, Problem::other("", message)));
        }
        None => Layout::from_columns(tokens.len())
            .ok_or_else(|| (None, Problem::value("", format!("{} columns", tokens.len()), "4, 5, 7 or 8")))?,
    };
    *style = Some((separator, layout));

    let mut v = [0.0; 8];
    for (i, token) in tokens.iter().enumerate() {
        v[i] = token
            .parse::<f64>()
            .ok()
            .filter(|n| n.is_finite())
            .ok_or_else(|| (Some(i + 1), Problem::value("", format!("`{token}`"), "a finite number")))?;
    }
    let at_least = |column: usize, what: &str, bad: bool, allowed: &str| match bad {
        true => Err((Some(column), Problem::value(what, v[column - 1], allowed))),
        false => Ok(()),
    };
    at_least(4, "d_p", v[3] <= 0.0, "a diameter > 0 um")?;
    let spheroid = if layout.spheroids {
        at_least(5, "e_p", v[4] <= 0.0, "an aspect ratio > 0")?;
        Some(Spheroid { e_p: v[4], alpha_rad: v[5], beta_rad: v[6] })
    } else {
        None
    };
    let c_int = if layout.c_int {
        let column = layout.columns();
        at_least(column, "c_int", v[column - 1] < 0.0, "a factor >= 0")?;
        v[column - 1]
    } else {
        1.0
    };
    Ok(Particle { x_px: v[0], y_px: v[1], z_um: v[2], d_um: v[3], spheroid, c_int })
}

/// Writes the particles in the given layout, numbers in the shortest form that reads back to the same value.
pub fn write(mut writer: impl Write, particles: &[Particle], layout: Layout) -> std::io::Result<()> {
    let needed = Layout::of(particles);
    if (needed.spheroids && !layout.spheroids) || (needed.c_int && !layout.c_int) {
        return Err(std::io::Error::new(
            std::io::ErrorKind::InvalidInput,
            "the layout drops columns that are in use",
        ));
    }
    let mut line = String::new();
    for p in particles {
        line.clear();
        for (i, value) in [p.x_px, p.y_px, p.z_um, p.d_um].into_iter().enumerate() {
            line.push_str(if i > 0 { " " } else { "" });
            number::push(&mut line, value);
        }
        let s = p.spheroid.unwrap_or(Spheroid { e_p: 1.0, alpha_rad: 0.0, beta_rad: 0.0 });
        let spheroid = layout.spheroids.then_some([s.e_p, s.alpha_rad, s.beta_rad]);
        for value in spheroid.into_iter().flatten().chain(layout.c_int.then_some(p.c_int)) {
            line.push(' ');
            number::push(&mut line, value);
        }
        line.push('\n');
        writer.write_all(line.as_bytes())?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn message(text: &str) -> String {
        read(text.as_bytes(), "d.txt").unwrap_err().to_string()
    }

    #[test]
    fn separators_and_comments() {
        let expected = [Particle::sphere(1.0, 2.5, -30.0, 2.0), Particle::sphere(4.0, 5.0, 1e1, 2.0)];
        for text in [
            "1 2.5 -30 2\n4 5 10 2\n",
            "# x y z d\n\n1\t2.5\t-30\t2\r\n  4   5 1e1 2 % last",
            "1, 2.5, -30, 2\n4,5,10,2",
            "1;2.5;-30;2\n4; 5; 10; 2\n",
        ] {
            assert_eq!(read(text.as_bytes(), "d.txt").unwrap(), expected, "{text}");
        }
        assert_eq!(read("% nothing\n".as_bytes(), "d.txt").unwrap(), []);
    }

    #[test]
    fn every_kind_of_problem_names_line_and_column() {
        for (text, expected) in [
            ("1 2 3 2\n1 2 3\n", "d.txt:2: 3 columns, but 4 before"),
            ("1 2 3\n", "d.txt:1: 3 columns: expected 4, 5, 7 or 8"),
            ("1 2 3 4 5 6\n", "d.txt:1: 6 columns"),
            ("1 2 3 4 5 6 7 8 9\n", "d.txt:1: 9 columns"),
            ("1 2 nan 2\n", "d.txt:1, column 3: `nan`: expected a finite number"),
            ("1 2 3 inf\n", "d.txt:1, column 4: `inf`"),
            ("1 2 3 0\n", "d.txt:1, column 4: d_p = 0: expected a diameter > 0"),
            ("1 2 3 2 0 0 0\n", "d.txt:1, column 5: e_p = 0"),
            ("1 2 3 2 -1\n", "d.txt:1, column 5: c_int = -1"),
            ("1 2 3 2 2 0 0 -1\n", "d.txt:1, column 8: c_int = -1"),
            ("1,5 2,5 3 2\n", "d.txt:1, column 1: `1,5`: a decimal comma?"),
            ("1,5;2;3;2\n", "d.txt:1, column 1: `1,5`: a decimal comma?"),
            ("1 2 3 2\n1 2 x 2\n1 2 3 -2\n", "d.txt:2, column 3: `x`"),
            ("# x y z d_p\r1 2 3 2\r", "d.txt:1: line end CR"),
        ] {
            assert!(message(text).contains(expected), "{} lacks {expected}", message(text));
        }
        assert_eq!(message("1 2 3 2\n1 2 x 2\n1 2 3 -2\n").lines().count(), 2);
        assert_eq!(message(&"x x x x\n".repeat(1000)).lines().count(), MAX_PROBLEMS);
    }

    prop_compose! {
        fn particle(layout: Layout)(
            x in -1e6..1e6f64, y in -1e6..1e6f64, z in -1e3..1e3f64, d in 1e-3..1e2f64,
            e in 1e-2..1e2f64, a in -7.0..7.0f64, b in -7.0..7.0f64, c in 0.0..1e3f64,
        ) -> Particle {
            Particle {
                x_px: x, y_px: y, z_um: z, d_um: d,
                spheroid: layout.spheroids.then_some(Spheroid { e_p: e, alpha_rad: a, beta_rad: b }),
                c_int: if layout.c_int { c } else { 1.0 },
            }
        }
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_back(
            (layout, particles) in (any::<bool>(), any::<bool>()).prop_flat_map(|(spheroids, c_int)| {
                let layout = Layout { spheroids, c_int };
                (Just(layout), prop::collection::vec(particle(layout), 0..20))
            })
        ) {
            let mut bytes = Vec::new();
            write(&mut bytes, &particles, layout).unwrap();
            prop_assert_eq!(read(&bytes[..], "d.txt").unwrap(), particles);
        }

        #[test]
        fn any_text_is_read_or_refused(text in "[0-9eE.,;+\\- \t\n#%a-f]{0,200}") {
            let _ = read(text.as_bytes(), "d.txt");
        }
    }
}
