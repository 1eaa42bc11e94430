//! Scenarios: their keys ([`spec`]), parsing ([`parse()`]), validation and defaults ([`resolve()`]).

mod brightness;
mod calibration;
mod drawing;
mod field;
mod field_of_view;
mod findings;
mod flow_checks;
mod focal_planes;
mod imaging;
mod language;
pub mod license;
mod load;
mod maps;
mod motion;
mod optics;
pub mod particles;
mod recorded;
mod recordings;
mod reference;
mod rendering;
mod resolve;
mod resolved;
mod shipped;
mod source;
pub mod spec;
mod splits;
mod suite;
mod sweep;
mod timing;
mod true_flow;
mod truth_grid;
mod volume;

pub use findings::Input;
pub use focal_planes::CylinderFacts;
pub use language::derive::schema_of;
pub use language::document::{Page, Picture, Scene};
pub use language::literal::Literal;
pub use language::schema::{Entry, Schema, ValueKind, nearest};
pub use language::text::number;
pub use language::write::ron;
pub use language::write::{compact, write};
pub use load::{Assignment, Parsed, SCENARIO, build, load, load_text, of_dataset, parse, set};
pub use motion::MotionSource;
pub use optics::sensor;
pub use recordings::Recordings;
pub use reference::{document, template};
pub use resolve::resolve;
pub use resolved::Scenario;
pub use shipped::{SHIPPED, Shipped, shipped, shipped_suites};
pub use source::{ScenarioText, read_text};
pub use splits::{Split, derived_seed, reseeded, sized};
pub use suite::{
    AxisLabel, AxisValue, LadderSpec, Metric, SUITE, Size, SizeSpec, Sizes, Suite, SuiteCase, SuiteSpec,
    TrackSpec, suite_schema,
};
pub use sweep::{Axis, Case, Combine, Span, Sweep, SweepSpec, Values, parse_sweep};
pub use true_flow::ScenarioFlow;
pub use truth_grid::{Nodes, Weighting};
