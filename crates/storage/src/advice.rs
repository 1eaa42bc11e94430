//! Messages that name options: each interface prints its own words for them.

use std::fmt;

/// An option that a message names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Named {
    /// Whether a shift of the result is estimated.
    AutoOffset,
    /// Width of the border that is not scored.
    Border,
    /// Whether the Cramér-Rao bound is computed.
    Crlb,
    /// The depth range.
    Depth,
    /// Number of dimensions.
    Dims,
    /// Whether what exists is replaced.
    Force,
    /// Format of a result.
    Format,
    /// Shape of the gate.
    GateShape,
    /// Width of the gate.
    GateXy,
    /// Height of the gate.
    GateZ,
    /// Gate of the ISBI scores.
    IsbiGate,
    /// Plane of the true field.
    Plane,
    /// Size of a pixel.
    UmPerPx,
    /// That y grows upward.
    YUp,
}

impl Named {
    /// The option of the command.
    pub fn option(self) -> &'static str {
        match self {
            Named::AutoOffset => "--auto-offset",
            Named::Border => "--border",
            Named::Crlb => "--crlb",
            Named::Depth => "--depth LOW HIGH",
            Named::Dims => "--dims",
            Named::Force => "--force",
            Named::Format => "--format",
            Named::GateShape => "--gate",
            Named::GateXy => "--gate-xy",
            Named::GateZ => "--gate-z",
            Named::IsbiGate => "--isbi-gate",
            Named::Plane => "--plane",
            Named::UmPerPx => "--um-per-px",
            Named::YUp => "--y up",
        }
    }
}

/// A part of a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Part {
    /// Words.
    Text(String),
    /// The name of an option.
    Option(Named),
}

impl From<Named> for Part {
    fn from(option: Named) -> Self {
        Part::Option(option)
    }
}

impl From<&str> for Part {
    fn from(text: &str) -> Self {
        Part::Text(text.to_owned())
    }
}

impl From<String> for Part {
    fn from(text: String) -> Self {
        Part::Text(text)
    }
}

/// A message; displayed with the options of the command.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Advice(pub Vec<Part>);

impl Advice {
    /// The message with these words for options.
    pub fn said(&self, word: impl Fn(Named) -> &'static str) -> String {
        let said = |part: &Part| match part {
            Part::Text(text) => text.clone(),
            Part::Option(option) => word(*option).to_owned(),
        };
        self.0.iter().map(said).collect()
    }
}

impl fmt::Display for Advice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.said(Named::option))
    }
}

/// A message from texts and options.
#[macro_export]
macro_rules! advice {
    ($($part:expr),+ $(,)?) => { $crate::advice::Advice(vec![$($crate::advice::Part::from($part)),+]) };
}
