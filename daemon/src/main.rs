#![doc = include_str!("../README.md")]

fn main() -> std::process::ExitCode {
    nacre_cli::main(env!("NACRE_COMMIT"), env!("NACRE_TARGET"))
}
