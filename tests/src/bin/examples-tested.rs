//! The programs of `examples/` as the tests run them: `examples-tested NAME`. One binary links the libraries
//! once.

#[path = "../../../examples/astigmatic_scan.rs"]
mod astigmatic_scan;
#[path = "../../../examples/first_recording.rs"]
mod first_recording;
#[path = "../../../examples/own_field.rs"]
mod own_field;
#[path = "../../../examples/piv_pair.rs"]
mod piv_pair;
#[path = "../../../examples/tracker_in_memory.rs"]
mod tracker_in_memory;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    match std::env::args().nth(1).as_deref() {
        Some("astigmatic_scan") => astigmatic_scan::main(),
        Some("first_recording") => first_recording::main(),
        Some("own_field") => own_field::main(),
        Some("piv_pair") => piv_pair::main(),
        Some("tracker_in_memory") => tracker_in_memory::main(),
        other => Err(format!("{other:?}: expected the name of a program").into()),
    }
}
