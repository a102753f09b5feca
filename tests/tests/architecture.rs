//! What the texts for people say about this repository is true today: every path exists, code that is quoted is code that
//! runs, and nothing leads to places that only one machine has.

use std::path::{Path, PathBuf};

/// Folders that programs make, in the repository's root or in a run directory; paths that begin with them need not be there.
const MADE: [&str; 6] = ["target", "runs", "results", "units", "checkpoints", "option_sets"];

/// The texts whose paths are looked at: those in the root and the pages of results.
fn pages() -> Vec<String> {
    let results = std::fs::read_dir(root().join("docs/results")).expect("the pages of results");
    let results = results.map(|entry| entry.expect("a page").file_name().to_string_lossy().into_owned());
    let results = results.filter(|name| name.ends_with(".md")).map(|name| format!("docs/results/{name}"));
    let mut pages: Vec<String> = results.collect();
    pages.sort();
    pages.extend(["README.md", "ARCHITECTURE.md", "CHANGELOG.md"].map(str::to_owned));
    pages
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the workspace").to_owned()
}

fn read(name: &str) -> String {
    std::fs::read_to_string(root().join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// A Markdown text without its fenced blocks.
fn prose(markdown: &str) -> String {
    let outside = markdown.split("\n```").step_by(2);
    outside.map(|part| part.split_once('\n').map_or(part, |(_, rest)| rest)).collect::<Vec<_>>().join("\n")
}

/// The fenced blocks that are marked with `language`.
fn blocks(markdown: &str, language: &str) -> Vec<String> {
    let inside = markdown.split("\n```").skip(1).step_by(2).filter_map(|part| part.split_once('\n'));
    inside.filter(|(mark, _)| *mark == language).map(|(_, code)| code.to_owned()).collect()
}

/// Code spans that look like paths, from the repository's root (not from that of the machine), and targets of links inside it, from `folder`, in which the text lies.
fn paths(markdown: &str, folder: &str) -> Vec<String> {
    let prose = prose(markdown);
    let looks_like_one = |span: &&str| {
        let named =
            [".md", ".rs", ".toml", ".xml"].iter().any(|end| span.ends_with(end)) && !span.starts_with('.');
        // What is not ASCII is a formula, such as 1/ε.
        (span.contains('/') || named)
            && span.is_ascii()
            && !span.contains(char::is_whitespace)
            && !span.starts_with(['-', '/'])
    };
    let spans = prose.split('`').skip(1).step_by(2).filter(looks_like_one);
    let links = prose.split("](").skip(1).filter_map(|rest| rest.split_once(')')).map(|(target, _)| target);
    let links = links.filter(|target| !target.starts_with("http") && !target.starts_with('#'));
    spans.map(str::to_owned).chain(links.map(|target| format!("{folder}{target}"))).collect()
}

/// The paths of a text that lead nowhere.
fn dead(markdown: &str, folder: &str) -> Vec<String> {
    let made = |path: &String| MADE.iter().any(|folder| path.split('/').next() == Some(folder));
    paths(markdown, folder).into_iter().filter(|path| !made(path) && !root().join(path).exists()).collect()
}

#[test]
fn every_path_that_the_texts_name_exists() {
    let pages = pages();
    assert!(pages.len() > 8, "{pages:?}");
    for name in pages {
        let folder = name.rfind('/').map_or("", |end| &name[..=end]);
        assert_eq!(dead(&read(&name), folder), Vec::<String>::new(), "{name}");
    }
    assert!(paths(&read("ARCHITECTURE.md"), "").len() > 50, "the map names too little to be one");
}

#[test]
fn dead_paths_are_seen_and_other_spans_are_not_taken_for_paths() {
    let text = "# Map\n`elo-core/src/lib.rs` and `elo-core/src/phase3.rs`, `a / b`, `1/ε`, `/usr/bin/nothing`, `--out`, `runs/x`, `simulator.kind=mujoco`\n\
                ```text\n`not/looked/at`\n```\nsee [there](docs/nothing.md), [here](README.md), [far](https://a.b/c)\n\
                ```\nnor/this\n```\nand `Missing.toml`\n";
    assert_eq!(dead(text, ""), ["elo-core/src/phase3.rs", "Missing.toml", "docs/nothing.md"]);
    // Links are from where the text lies.
    assert_eq!(dead("[page](teachers.md) and [none](none.md)", "docs/results/"), ["docs/results/none.md"]);
    assert_eq!(blocks("a\n```rust\nlet x = 1;\n```\nb\n```text\nno\n```\n", "rust"), ["let x = 1;"]);
}

#[test]
fn the_rust_of_the_readme_is_that_of_the_example() {
    let example = read("examples/play-option-set/src/main.rs");
    let shown = blocks(&read("README.md"), "rust");
    assert!(!shown.is_empty());
    for block in shown {
        // The example's lines stand in a function, four columns further to the right.
        let indented: Vec<String> = block
            .lines()
            .map(|line| if line.is_empty() { String::new() } else { format!("    {line}") })
            .collect();
        assert!(example.contains(&indented.join("\n")), "not in the example:\n{block}");
    }
}

/// What a workspace's `dependency` is to a package that lies beside the repository.
fn from_outside(dependency: &toml::Value) -> toml::Value {
    let mut found = dependency.clone();
    if let Some(path) = found.get_mut("path") {
        *path = format!("../elo/{}", path.as_str().expect("a path")).into();
    }
    found
}

#[test]
fn the_dependencies_in_the_readme_are_those_of_the_package_that_it_names() {
    let blocks = blocks(&read("README.md"), "toml");
    let [shown] = &blocks.iter().filter(|block| block.starts_with("[dependencies]")).collect::<Vec<_>>()[..]
    else {
        panic!("one block of dependencies: {blocks:?}")
    };
    let shown: toml::Table = shown.parse().expect("TOML");
    let package: toml::Table = read("examples/own-plugins/Cargo.toml").parse().expect("TOML");
    let workspace: toml::Table = read("Cargo.toml").parse().expect("TOML");
    let mut needed = toml::Table::new();
    for (name, here) in package["dependencies"].as_table().expect("dependencies") {
        let mut outside = from_outside(&workspace["workspace"]["dependencies"][name]);
        if let (Some(features), Some(outside)) = (here.get("features"), outside.as_table_mut()) {
            outside.insert("features".to_owned(), features.clone());
        }
        needed.insert(name.clone(), outside);
    }
    assert_eq!(shown["dependencies"], toml::Value::Table(needed));
}

/// The texts below `folder`, by their paths: code, configs and documentation, without what programs make.
fn texts(folder: &Path) -> Vec<(PathBuf, String)> {
    let entries = std::fs::read_dir(folder).expect("a folder of the repository");
    let mut paths: Vec<PathBuf> =
        entries.map(|entry| entry.expect("a folder of the repository").path()).collect();
    paths.sort();
    let inside = |path: PathBuf| {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let hidden = name.starts_with('.') && ![".ci", ".cargo", ".gitignore"].contains(&name);
        // A folder of the same name deeper down, such as `docs/results`, is the repository's own.
        if hidden || (folder == root() && MADE.contains(&name)) {
            Vec::new()
        } else if path.is_dir() {
            texts(&path)
        } else {
            std::fs::read_to_string(&path).map(|text| vec![(path, text)]).unwrap_or_default()
        }
    };
    paths.into_iter().flat_map(inside).collect()
}

#[test]
fn nothing_leads_to_one_machine() {
    // In pieces, so that this file does not hold what it looks for.
    let strange = [["/wo", "rk/"], ["../sha", "red"], ["/ro", "ot/"], ["/ho", "me/"], ["/Us", "ers/"]]
        .map(|p| p.concat());
    let texts = texts(&root());
    assert!(texts.len() > 150, "{} files", texts.len());
    for (path, text) in texts {
        for (number, line) in text.lines().enumerate() {
            let found = strange.iter().find(|place| line.contains(place.as_str()));
            assert!(found.is_none(), "{}:{}: {line}", path.display(), number + 1);
        }
    }
}
