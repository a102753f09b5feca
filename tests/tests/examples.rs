//! Every config in `examples/` is one that the program takes: what `elo config check` does, for each.

use std::path::{Path, PathBuf};

use elo_core::config;
use elo_core::experiment::Experiment;
use elo_core::fault::{Fault, Faults};
use elo_core::plugin::{Plugin, Role};

const PLUGINS: [&[Plugin]; 4] =
    [elo_core::plugin::PLUGINS, elo_backends::PLUGINS, elo_learners::PLUGINS, own_plugins::PLUGINS];

fn examples() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).with_file_name("examples")
}

/// The configs below `folder`, by name: every TOML file that is no package.
fn configs(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("a folder of the repository");
    let mut paths: Vec<PathBuf> =
        entries.map(|entry| entry.expect("a folder of the repository").path()).collect();
    paths.sort();
    let inside = |path: PathBuf| match path.extension() {
        _ if path.is_dir() => configs(&path),
        Some(extension) if extension == "toml" && !path.ends_with("Cargo.toml") => vec![path],
        _ => Vec::new(),
    };
    paths.into_iter().flat_map(inside).collect()
}

fn read(path: &Path, overrides: &[String]) -> Result<Experiment, Vec<Fault>> {
    let text = std::fs::read_to_string(path).expect("a file of the repository");
    let reading = config::read::<Experiment>(&text, path, overrides, &PLUGINS);
    let mut reading = reading.unwrap_or_else(|error| panic!("{error}"));
    assert!(reading.notices.is_empty(), "{}: {:?}", path.display(), reading.notices);
    let mut faults = Faults::new();
    let folder = path.parent().expect("a file has a folder");
    faults.within("simulator", |faults| reading.config.simulator.embed_files(folder, faults));
    // What only a worker knows is missing here; `python/tests/test_examples.py` runs those configs whole.
    let mut hosted = reading.config.hosted_mut().into_iter();
    if !hosted.any(|(_, hosted)| hosted.needs_description()) {
        reading.config.validate(&mut faults);
    }
    if faults.found().is_empty() { Ok(reading.config) } else { Err(faults.into_found()) }
}

#[test]
fn every_config_is_without_faults_and_shows_itself_as_it_is() {
    let found = configs(&examples());
    for name in [
        "ant-quick",
        "half-cheetah-quick",
        "walker2d-quick",
        "hopper-quick",
        "paper/ant",
        "closed-loop/quick",
        "own-plugins/cart-pole",
    ] {
        assert!(found.contains(&examples().join(format!("{name}.toml"))), "{name} is gone: {found:?}");
    }
    for path in found {
        let experiment = read(&path, &[]).unwrap_or_else(|faults| panic!("{}: {faults:?}", path.display()));
        let shown = config::show(&experiment).expect("it can be written");
        let again =
            config::read::<Experiment>(&shown, &path, &[], &PLUGINS).expect("what is shown can be read");
        assert_eq!(config::show(&again.config).expect("it can be written"), shown, "{}", path.display());
    }
}

/// What `elo example KIND` prints for `plugin`, and the sections that it leaves out.
fn whole(plugin: &Plugin) -> Option<String> {
    let text = config::example(plugin, &PLUGINS)?;
    let sections = [
        (Role::Simulator, "[simulator]\nkind = 'point_mass'\n"),
        (Role::OptionLearner, "[option_learner]\nkind = 'open_loop'\n"),
        (Role::Metric, "[[metrics]]\nkind = 'maximum_mean'\n"),
    ];
    let others = sections.into_iter().filter(|(role, _)| *role != plugin.role).map(|(_, section)| section);
    Some(format!("seed = 1\n{}{text}", others.collect::<String>()))
}

#[test]
fn what_example_prints_of_every_kind_is_a_config_and_names_every_field() {
    for plugin in PLUGINS.iter().flat_map(|slice| slice.iter()) {
        let Some(text) = whole(plugin) else { continue };
        let reading = config::read::<Experiment>(&text, Path::new("example"), &[], &PLUGINS);
        reading.unwrap_or_else(|error| panic!("{}: {error}\n{text}", plugin.kind));
    }
    let of = |kind: &str| PLUGINS.iter().flat_map(|slice| slice.iter()).find(|plugin| plugin.kind == kind);
    let text = |kind: &str| of(kind).and_then(whole).unwrap_or_else(|| panic!("there is no {kind}"));
    for (kind, lines) in [
        ("python", ["#   parameter: ", "#   binding: ", "#     \"price\": ", "#   get: ", "#   set: "]),
        (
            "rapier",
            ["#   torso: ", "#     max_pitch: ", "#     offset: ", "#   feet: ", "# own_robot = { name = …"],
        ),
        (
            "interest",
            ["#   \"mean\": ", "#   { negative_tail = … }: ", "#     k: ", "#     alpha: ", "risk = "],
        ),
    ] {
        let text = text(kind);
        for line in lines {
            assert!(text.lines().any(|other| other.starts_with(line)), "{line} in\n{text}");
        }
    }
}

#[test]
fn the_configs_of_robots_with_legs_serve_both_engines() {
    let ours = |path: &PathBuf| {
        !path.starts_with(examples().join("own-plugins")) && !path.starts_with(examples().join("python"))
    };
    for path in configs(&examples()).into_iter().filter(ours) {
        for kind in ["rapier", "mujoco"] {
            let overrides = [format!("simulator.kind={kind}")];
            let experiment = read(&path, &overrides);
            let experiment =
                experiment.unwrap_or_else(|faults| panic!("{} {kind}: {faults:?}", path.display()));
            assert_eq!(experiment.simulator.engine().name, kind, "{}", path.display());
        }
    }
}

#[test]
fn the_presets_of_the_paper_have_its_sizes() {
    for robot in ["ant", "half-cheetah", "walker2d"] {
        let preset = read(&examples().join(format!("paper/{robot}.toml")), &[]).expect("no faults");
        let sizes = &preset.discover;
        let sizes = [sizes.candidates, sizes.contexts, sizes.steps, sizes.set_size, sizes.teachers];
        assert_eq!(sizes, [600, 300, 200, 5, 10], "{robot}");
        assert_eq!(preset.simulator.spec().expect("a built-in robot").robot, robot);
    }
}
