//! Files that are not trusted: robots and option sets.

use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use elo_core::config;
use elo_core::experiment::Experiment;
use elo_core::option_set::OptionSet;
use elo_core::seed::Seed;
use elo_tests::PLUGINS;
use elo_tests::programs::{elo_with, run, write};
use elo_tests::toy::{TOY, experiment, formats};
use rand::RngExt as _;

use crate::{own_robot, own_robot_toy, reference};

#[test]
fn hostile_mjcf_files_are_refused_by_the_name_of_the_element() {
    let folder = tempfile::tempdir().unwrap();
    let (_, good) = own_robot();
    let config = write(folder.path(), "own.toml", &own_robot_toy(&[]));
    let path = folder.path().join("robot.xml");
    let check = || {
        let begun = Instant::now();
        let mut command = elo_with(&["config", "check"]);
        let ran = run(command.arg(&config));
        assert!(begun.elapsed() < Duration::from_secs(20), "{:?}", begun.elapsed());
        ran
    };
    fs::write(&path, &good).unwrap();
    check().expect_success();

    let inside = |element: &str| good.replacen("<worldbody>", &format!("<worldbody>{element}"), 1);
    let before = |element: &str| good.replacen("<worldbody>", &format!("{element}<worldbody>"), 1);
    let bomb = "<!DOCTYPE m [<!ENTITY a \"aaaaaaaaaa\"><!ENTITY b \"&a;&a;&a;&a;&a;&a;&a;&a;\">]>";
    let xxe = "<!DOCTYPE m [<!ENTITY x SYSTEM \"file:///etc/passwd\">]>";
    let nested = "<replicate count='1000'>".repeat(3) + &"</replicate>".repeat(3);
    let deep = "<body>".repeat(50_000) + &"</body>".repeat(50_000);
    let many = "<site/>".repeat(20_000);
    let corpus: Vec<(&str, String, &str)> = vec![
        ("include of an absolute path", inside("<include file='/etc/passwd'/>"), "<include>"),
        ("include of a path upwards", before("<include file='../../secret.xml'/>"), "<include>"),
        ("a hundred million copies", inside("<replicate count='1e8'><geom/></replicate>"), "<replicate>"),
        ("copies of copies", inside(&nested), "<replicate>"),
        ("a composite", inside("<composite type='grid' count='1000 1000 1000'/>"), "<composite>"),
        ("a flexible grid", inside("<flexcomp name='x' count='999 999 999'/>"), "<flexcomp"),
        ("time that stands still", before("<option timestep='0'/>"), "<option>"),
        ("time that is not a number", before("<option timestep='nan'/>"), "<option>"),
        ("time that goes back", before("<option timestep='-0.01'/>"), "<option>"),
        ("two billion iterations", before("<option iterations='2000000000'/>"), "<option>"),
        ("a terabyte of memory", before("<size memory='1T'/>"), "<size>"),
        ("more than a machine word of memory", before("<size memory='99999999999999999999G'/>"), "<size>"),
        ("a mesh from a file", before("<asset><mesh name='m' file='/dev/zero'/></asset>"), "<mesh"),
        (
            "a height field from a file",
            before("<asset><hfield name='h' file='/dev/zero'/></asset>"),
            "<hfield",
        ),
        ("a texture from a file", before("<asset><texture name='t' file='/dev/zero'/></asset>"), "<texture"),
        ("a folder of meshes", before("<compiler meshdir='/'/>"), "<compiler>"),
        ("a plugin", before("<extension><plugin plugin='x'/></extension>"), "<extension>"),
        ("a number too large", inside("<geom type='sphere' size='1e300'/>"), "<geom>"),
        ("a geom of a mesh", inside("<geom type='mesh' mesh='m'/>"), "<geom>"),
        ("fifty thousand bodies inside one another", inside(&deep), "elements"),
        ("twenty thousand elements", inside(&many), "<site>"),
        ("entities of entities", format!("{bomb}{good}"), "DTD"),
        ("an entity of another file", format!("{xxe}{good}"), "DTD"),
        ("half a file", good[..good.len() / 2].to_owned(), "no MJCF"),
        ("another root", "<robot name='urdf'/>".to_owned(), "<robot"),
        ("nothing", String::new(), "does not begin with `<`"),
        ("no text", "\u{0}MJB\u{1}".repeat(100), "does not begin with `<`"),
        ("more than a megabyte", format!("{good}<!--{}-->", "x".repeat(1 << 20)), "larger than"),
    ];
    for (what, text, named) in &corpus {
        fs::write(&path, text).unwrap();
        let ran = check().expect_code(2);
        assert!(ran.stderr.contains("own_robot") && ran.stderr.contains(named), "{what}: {ran}");
    }

    let refused = |what: &str, named: &str| {
        let ran = check().expect_code(2);
        assert!(
            ran.stderr.contains("simulator.own_robot.mjcf") && ran.stderr.contains(named),
            "{what}: {ran}"
        );
        let _ = fs::remove_file(&path);
    };
    fs::remove_file(&path).unwrap();
    refused("no file", "No such file");
    std::os::unix::fs::symlink("/dev/zero", &path).unwrap();
    refused("a link to a device", "no regular file");
    assert!(Command::new("mkfifo").arg(&path).status().unwrap().success());
    refused("a pipe", "no regular file");
    fs::write(&path, b"<mujoco \xff\xfe>").unwrap();
    refused("bytes that are no text", "UTF-8");
    fs::create_dir(&path).unwrap();
    refused("a folder", "no regular file");
}

#[test]
fn damaged_option_sets_are_read_or_refused_and_never_panic() {
    let (_, _, out) = reference();
    let set = out.join("results/option_sets/maximum_mean");
    let folder = tempfile::tempdir().unwrap();
    let spec = experiment(TOY).simulator.spec().unwrap();
    let formats = formats();
    let originals: Vec<(&str, Vec<u8>)> = ["manifest.json", "options.safetensors"]
        .map(|name| (name, fs::read(set.join(name)).unwrap()))
        .to_vec();
    let restore =
        || originals.iter().for_each(|(name, bytes)| fs::write(folder.path().join(name), bytes).unwrap());
    restore();
    let whole = OptionSet::read(folder.path()).unwrap();
    whole.policies(&spec, &formats).unwrap();

    // What `elo evaluate` does with a set before it runs anything.
    let take = || -> Result<(), String> {
        let set = OptionSet::read(folder.path()).map_err(|error| error.to_string())?;
        let text = toml::to_string(&set.manifest.experiment).map_err(|error| error.to_string())?;
        config::read::<Experiment>(&text, Path::new("manifest"), &[], PLUGINS)
            .map_err(|error| error.to_string())?;
        set.policies(&spec, &formats).map(drop).map_err(|error| error.to_string())
    };
    assert_eq!(take(), Ok(()));
    let mut stream = Seed::root(27).stream();
    let (mut refused, mut tried) = (0, 0);
    for (name, original) in &originals {
        for _ in 0..2500 {
            let mut bytes = original.clone();
            let at = stream.random_range(0..bytes.len());
            match stream.random_range(0..4) {
                0 => bytes.truncate(at),
                1 => {
                    // A stretch from elsewhere in the file.
                    let from = stream.random_range(0..bytes.len());
                    let length = stream.random_range(0..64).min(bytes.len() - at.max(from));
                    bytes.copy_within(from..from + length, at);
                }
                2 => bytes[at] = b"0123456789-eE\"{}[],:"[stream.random_range(0..20)],
                _ => bytes[at] ^= 1 << stream.random_range(0..8),
            }
            fs::write(folder.path().join(name), &bytes).unwrap();
            let outcome = catch_unwind(AssertUnwindSafe(take));
            refused += usize::from(outcome.unwrap_or_else(|_| panic!("{name}, {at}: a panic")).is_err());
            tried += 1;
        }
        restore();
    }
    assert!(refused > tried / 4, "{refused} of {tried} were refused");
}

#[test]
fn numbers_that_are_not_finite_and_missing_options_are_refused() {
    let (_, _, out) = reference();
    let set = out.join("results/option_sets/maximum_mean");
    let spec = experiment(TOY).simulator.spec().unwrap();
    let said = |change: &dyn Fn(&mut OptionSet)| {
        let folder = tempfile::tempdir().unwrap();
        let mut changed = OptionSet::read(&set).unwrap();
        change(&mut changed);
        for (name, bytes) in changed.files() {
            fs::write(folder.path().join(name), bytes).unwrap();
        }
        let mut command = elo_with(&["evaluate"]);
        let ran = run(command.arg(folder.path())).expect_code(2);
        // The library refuses what the program refuses.
        let read = OptionSet::read(folder.path()).and_then(|set| set.policies(&spec, &formats()).map(drop));
        assert!(read.is_err(), "{ran}");
        ran.stderr
    };
    let text = said(&|set| {
        let shape = set.options[1].tensors.get("actions").unwrap().shape.clone();
        let mut data = set.options[1].tensors.get("actions").unwrap().data.clone();
        data[3] = f32::INFINITY;
        set.options[1].tensors.insert("actions", &shape, data);
    });
    assert!(text.contains("tensor `1.actions` has a number that is not finite"), "{text}");
    let text = said(&|set| set.options.truncate(1));
    assert!(text.contains("option 1: tensor `actions` is missing"), "{text}");
    let text = said(&|set| set.options[0].tensors.insert("actions", &[5, 4], vec![0.0; 20]));
    assert!(text.contains("option 0: tensor `actions` has shape [5, 4]"), "{text}");
    let text = said(&|set| set.manifest.options[2].policy = "pickle".to_owned());
    assert!(text.contains("no plugin reads policies of format `pickle`"), "{text}");
    let text = said(&|set| set.manifest.format = 3);
    assert!(text.contains("option-set format 3, this program reads formats 1 to 2"), "{text}");
}
