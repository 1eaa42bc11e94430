//! The `microsig` command as the tests run it: Cargo builds the binaries of a package before its tests, those
//! of other packages only when asked to, and then with other features of their dependencies, all of them
//! anew.

fn main() -> std::process::ExitCode {
    bench::cli::main()
}
