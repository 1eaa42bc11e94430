//! The `microsig` command.

fn main() -> std::process::ExitCode {
    bench::cli::main()
}
