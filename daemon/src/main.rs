//! `nacre`: see the library's [`nacre::main`].

fn main() -> std::process::ExitCode {
    nacre::main()
}
