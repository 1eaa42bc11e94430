//! microsig
fn main() {}
