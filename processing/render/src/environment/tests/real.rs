use crate::environment::Environment;

/// Published environments are read completely.
#[test]
fn real_environments_are_read() {
    let Ok(folder) = std::env::var("NACRE_TEST_DATA") else {
        println!("skipped: NACRE_TEST_DATA is not set");
        return;
    };
    let folder = std::path::Path::new(&folder).join("envmaps");
    let Ok(files) = std::fs::read_dir(&folder) else {
        println!("skipped: there is no {}", folder.display());
        return;
    };
    for file in files {
        let path = file.unwrap().path();
        let environment = Environment::read(&path, None).unwrap();
        let most = environment.rgb.as_flattened().iter().fold(0.0_f32, |m, v| m.max(*v));
        println!("{}: {} x {}, up to {most}", path.display(), environment.width, environment.height);
        assert!(environment.width == 2 * environment.height && most > 1.0);
    }
}
