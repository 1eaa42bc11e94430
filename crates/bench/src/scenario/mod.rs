//! Scenarios: as written ([`spec`]), as read ([`parse()`]), as checked and filled ([`resolve()`]).

pub mod effects;
mod field;
mod files;
mod illumination;
pub mod keys;
pub mod license;
mod load;
mod meanings;
mod motion;
mod optics;
mod outline;
mod parse;
mod particles;
mod problems;
mod recorded;
pub mod reference;
mod resolve;
mod set;
pub mod spec;
mod sweep;
mod timing;
mod truth_grid;

pub use files::Input;
pub use load::{SCENARIO, load, of_dataset};
pub use motion::Mover;
pub use parse::{compact, parse, write};
pub use resolve::{Scenario, resolve};
pub use set::{assignment, set};
pub use sweep::{Axis, Case, Combine, Span, Sweep, SweepSpec, Values, parse_sweep};
pub use timing::Recordings;

pub use truth_grid::{Nodes, Weighting};

/// A commented scenario to start from: `microsig new` writes it.
pub const TEMPLATE: &str = include_str!("template.ron");

#[cfg(test)]
mod tests {
    use super::*;

    /// The comments call the values defaults, so they must be.
    #[test]
    fn the_template_says_the_defaults() {
        let bare = r#"(name: "mine", motion: flow(field: poiseuille()), timing: pairs(count: 10))"#;
        let read = |text| resolve(parse(text, "s.ron").unwrap(), std::path::Path::new(".")).unwrap().spec;
        let template = read(TEMPLATE);
        let description = template.description.clone();
        assert_eq!(spec::Spec { description, ..read(bare) }, template);
    }
}
