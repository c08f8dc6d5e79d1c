#![doc = include_str!("../README.md")]

fn main() -> std::process::ExitCode {
    nacre_cli::main()
}
