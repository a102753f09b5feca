//! What is refused in a user's MJCF file before any engine sees it.
//!
//! An engine's loader follows includes to any path, opens pipes, replicates elements without bound and accepts time
//! steps that never advance. So the text must consist of known elements, the attributes of known words or finite
//! numbers, and everything that costs memory or time must lie under a cap. The robot itself is not checked here.

use std::collections::{BTreeMap, BTreeSet};

use roxmltree::{Document, Node, ParsingOptions};

use super::vocabulary;

/// The largest file, in bytes.
pub const MAX_BYTES: usize = 1 << 20;

/// Elements in a file; a robot with 100 joints has some 500.
const MAX_ELEMENTS: usize = 10_000;
/// Elements inside one another.
const MAX_DEPTH: usize = 100;
/// Of bodies, of joints and of actuators.
const MAX_OF_A_KIND: usize = 500;
/// Of any number: lengths, masses, gears and stiffnesses of real robots lie far below.
const MAX_NUMBER: f64 = 1e10;
/// Faults reported; a file of another format would give thousands.
const MAX_FAULTS: usize = 10;

/// Every element that may occur. Anything else names a file (`include`, `mesh`, `hfield`, `texture`, `model`), code
/// (`plugin`, `extension`), repetition (`replicate`, `composite`, `flexcomp`), or physics that not all engines here have.
const ELEMENTS: [&str; 32] = [
    "mujoco",
    "compiler",
    "option",
    "size",
    "statistic",
    "visual",
    "global",
    "quality",
    "headlight",
    "map",
    "scale",
    "rgba",
    "default",
    "asset",
    "material",
    "worldbody",
    "body",
    "inertial",
    "joint",
    "freejoint",
    "geom",
    "site",
    "camera",
    "light",
    "contact",
    "exclude",
    "actuator",
    "motor",
    "keyframe",
    "key",
    "custom",
    "numeric",
];

/// Attributes that hold a name or a word; all others hold numbers.
const WORDS: [&str; 26] = [
    "name",
    "class",
    "childclass",
    "model",
    "joint",
    "body1",
    "body2",
    "type",
    "angle",
    "eulerseq",
    "coordinate",
    "integrator",
    "cone",
    "jacobian",
    "solver",
    "material",
    "mode",
    "target",
    "fluidshape",
    "inertiafromgeom",
    "limited",
    "ctrllimited",
    "forcelimited",
    "actfrclimited",
    "autolimits",
    "align",
];

/// Attributes that are refused by name, with the reason.
const REFUSED: [(&str, &str); 12] = [
    ("file", "other files are not read"),
    ("meshdir", "other files are not read"),
    ("texturedir", "other files are not read"),
    ("assetdir", "other files are not read"),
    ("texture", "textures are not read"),
    ("mesh", "only primitive geoms are supported"),
    ("hfield", "only primitive geoms are supported"),
    ("plugin", "plugins are not loaded"),
    ("fusestatic", "it renumbers the bodies"),
    ("delay", "motors act at once"),
    ("nsample", "motors act at once"),
    ("user", "user data is not read"),
];

/// `[low, high]` of attributes that cost time or memory, or that stop time; element, attribute, bounds.
const BOUNDS: [(&str, &str, f64, f64); 14] = [
    ("option", "timestep", 1e-5, 0.1),
    ("option", "iterations", 1.0, 1000.0),
    ("option", "ls_iterations", 1.0, 1000.0),
    ("option", "noslip_iterations", 0.0, 1000.0),
    ("option", "ccd_iterations", 1.0, 1000.0),
    ("option", "sdf_iterations", 0.0, 1000.0),
    ("option", "sdf_initpoints", 0.0, 1000.0),
    ("option", "mpr_iterations", 1.0, 1000.0),
    ("size", "nconmax", -1.0, 10_000.0),
    ("size", "njmax", -1.0, 100_000.0),
    ("size", "nstack", -1.0, 1e7),
    ("size", "nkey", 0.0, 1000.0),
    ("numeric", "size", 0.0, 1000.0),
    ("quality", "shadowsize", 0.0, 16_384.0),
];

/// `<size memory>` at most, in bytes; the three robots need less than a megabyte.
const MAX_MEMORY: f64 = 256.0 * 1024.0 * 1024.0;

/// Whether `mjcf` is a file's text rather than its path.
pub fn is_text(mjcf: &str) -> bool {
    mjcf.trim_start_matches('\u{feff}').trim_start().starts_with('<')
}

/// Checks a file's text.
///
/// # Errors
/// What was found, each with its element and line; at most ten findings.
pub fn check(text: &str) -> Result<(), Vec<String>> {
    if text.len() > MAX_BYTES {
        return Err(vec![format!("the file has {} bytes, expected at most {MAX_BYTES}", text.len())]);
    }
    if deeper_than(text, MAX_DEPTH) {
        return Err(vec![format!("expected at most {MAX_DEPTH} elements inside one another")]);
    }
    // Entities and document types are refused by `allow_dtd`.
    let options = ParsingOptions { allow_dtd: false, nodes_limit: 8 * MAX_ELEMENTS as u32 };
    let document = Document::parse_with_options(text, options).map_err(|e| vec![format!("no MJCF: {e}")])?;
    let mut scan =
        Scan { document: &document, counts: BTreeMap::new(), names: BTreeSet::new(), faults: Vec::new() };
    if document.root_element().tag_name().name() != "mujoco" {
        scan.fault(document.root_element(), "expected <mujoco>".to_owned());
    }
    scan.walk();
    if scan.faults.is_empty() { Ok(()) } else { Err(scan.faults) }
}

/// Whether more than `limit` elements lie inside one another. XML parsers recurse, so this looks at tags alone, as far as
/// the text is well-formed; no parser goes further than that.
fn deeper_than(text: &str, limit: usize) -> bool {
    let (mut rest, mut depth) = (text, 0_usize);
    while let Some(start) = rest.find('<') {
        rest = &rest[start..];
        let skips = [("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>"), ("<!", ">"), ("</", ">")];
        if let Some((opens, closes)) = skips.into_iter().find(|(opens, _)| rest.starts_with(opens)) {
            depth = depth.saturating_sub(usize::from(opens == "</"));
            let Some(end) = rest[opens.len()..].find(closes) else { return false };
            rest = &rest[opens.len() + end + closes.len()..];
            continue;
        }
        let mut quote = None;
        let end = rest.char_indices().find_map(|(i, c)| match (quote, c) {
            (None, '>') => Some(i),
            (None, '"' | '\'') => {
                quote = Some(c);
                None
            }
            (Some(open), c) if open == c => {
                quote = None;
                None
            }
            _ => None,
        });
        let Some(end) = end else { return false };
        if !rest[..end].ends_with('/') {
            depth += 1;
            if depth > limit {
                return true;
            }
        }
        rest = &rest[end..];
    }
    false
}

struct Scan<'a, 'input> {
    document: &'a Document<'input>,
    counts: BTreeMap<&'a str, usize>,
    names: BTreeSet<(&'a str, &'a str)>,
    faults: Vec<String>,
}

impl<'a> Scan<'a, '_> {
    fn fault(&mut self, node: Node<'_, '_>, message: String) {
        if self.faults.len() < MAX_FAULTS {
            let line = self.document.text_pos_at(node.range().start).row;
            let name = node.attribute("name").map_or(String::new(), |name| format!(" name=\"{name}\""));
            self.faults.push(format!("line {line}, <{}{name}>: {message}", node.tag_name().name()));
        }
    }

    fn walk(&mut self) {
        let root: Node<'a, '_> = self.document.root_element();
        let defaults = root.descendants().filter(|node| node.has_tag_name("default"));
        let mut classes: BTreeSet<&str> = defaults.filter_map(|node| node.attribute("class")).collect();
        classes.insert("main");
        for (count, node) in root.descendants().filter(Node::is_element).enumerate() {
            if count >= MAX_ELEMENTS {
                return self.fault(node, format!("expected at most {MAX_ELEMENTS} elements"));
            }
            self.element(node);
            for attribute in ["class", "childclass"] {
                if let Some(class) = node.attribute(attribute).filter(|class| !classes.contains(class)) {
                    self.fault(
                        node,
                        format!("{attribute}=\"{}\": no <default> has this class", shorten(class)),
                    );
                }
            }
        }
    }

    fn element(&mut self, node: Node<'a, '_>) {
        let tag = node.tag_name().name();
        if !ELEMENTS.contains(&tag) {
            return self.fault(node, "this element is not supported".to_owned());
        }
        let count = self.counts.entry(tag).or_default();
        *count += 1;
        if *count == MAX_OF_A_KIND + 1 && ["body", "joint", "geom", "motor", "site", "key"].contains(&tag) {
            self.fault(node, format!("expected at most {MAX_OF_A_KIND} of these"));
        }
        if let Some(name) = node.attribute("name").filter(|name| !self.names.insert((tag, name))) {
            self.fault(node, format!("another <{tag}> is called `{}` too", shorten(name)));
        }
        for attribute in node.attributes() {
            if let Err(message) = check_attribute(tag, attribute.name(), attribute.value()) {
                self.fault(
                    node,
                    format!("{}=\"{}\": {message}", attribute.name(), shorten(attribute.value())),
                );
            }
        }
    }
}

fn check_attribute(tag: &str, name: &str, value: &str) -> Result<(), String> {
    if let Some((_, reason)) = REFUSED.iter().find(|(refused, _)| *refused == name) {
        return Err((*reason).to_owned());
    }
    if tag == "geom" && name == "type" && ["mesh", "hfield", "sdf"].contains(&value) {
        return Err("only primitive geoms are supported".to_owned());
    }
    vocabulary::check(tag, name, value)?;
    if tag == "size" && name == "memory" {
        return check_memory(value);
    }
    let switch = ["true", "false", "auto", "enable", "disable"].contains(&value);
    if WORDS.contains(&name) || switch {
        return Ok(());
    }
    for token in value.split_ascii_whitespace() {
        let number: f64 = token.parse().map_err(|_| format!("`{}` is no number", shorten(token)))?;
        if !number.is_finite() || number.abs() > MAX_NUMBER {
            return Err(format!("expected numbers between -1e10 and 1e10, got {number}"));
        }
        let bounds = BOUNDS.iter().find(|(element, attribute, ..)| (*element, *attribute) == (tag, name));
        if let Some((.., low, high)) = bounds
            && !(*low..=*high).contains(&number)
        {
            return Err(format!("expected {low} to {high}, got {number}"));
        }
    }
    Ok(())
}

/// `-1` (automatic), or bytes with a suffix K, M, G and so on.
fn check_memory(value: &str) -> Result<(), String> {
    let unit = value.trim().chars().last().map_or(1.0, |suffix| match suffix.to_ascii_uppercase() {
        'K' => 1024.0,
        'M' => 1024.0 * 1024.0,
        '0'..='9' => 1.0,
        _ => f64::INFINITY,
    });
    let digits = value.trim().trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let number: f64 = digits.parse().map_err(|_| "expected bytes, e.g. 64M".to_owned())?;
    let bytes = if number == -1.0 { 0.0 } else { number * unit };
    if (0.0..=MAX_MEMORY).contains(&bytes) { Ok(()) } else { Err("expected at most 256M".to_owned()) }
}

fn shorten(text: &str) -> String {
    if text.chars().count() <= 40 {
        text.to_owned()
    } else {
        text.chars().take(40).chain("…".chars()).collect()
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::locomotion::robot::{NAMES, built_in};

    /// The text must be refused with a message that holds every one of `words`.
    fn refused(text: &str, words: &[&str]) {
        let faults = check(text).unwrap_err().join("; ");
        for word in words {
            assert!(faults.contains(word), "expected `{word}` in: {faults}");
        }
    }

    fn world(inside: &str) -> String {
        format!("<mujoco>\n<worldbody>{inside}</worldbody></mujoco>")
    }

    #[test]
    fn the_robots_pass() {
        for name in NAMES {
            assert_eq!(check(&built_in(name).unwrap().mjcf), Ok(()), "{name}");
        }
    }

    #[test]
    fn nothing_reaches_another_file() {
        for path in ["/etc/passwd", "../secret.xml", "link.xml"] {
            refused(&format!("<mujoco>\n<include file=\"{path}\"/></mujoco>"), &["line 2", "<include>"]);
        }
        refused(
            r#"<mujoco><asset><mesh name="m" file="/dev/stdin"/></asset></mujoco>"#,
            &["<mesh name=\"m\">"],
        );
        refused(r#"<mujoco><asset><hfield file="a.png"/></asset></mujoco>"#, &["<hfield>"]);
        refused(r#"<mujoco><asset><texture file="a.png"/></asset></mujoco>"#, &["<texture>"]);
        refused(r#"<mujoco><asset><material texture="t"/></asset></mujoco>"#, &["<material>", "texture"]);
        refused(r#"<mujoco><compiler meshdir="/"/></mujoco>"#, &["<compiler>", "meshdir"]);
        refused(&world(r#"<geom type="mesh" mesh="m"/>"#), &["<geom>", "primitive"]);
        refused(&world(r#"<body><attach model="m" body="b" prefix="p"/></body>"#), &["<attach>"]);
    }

    #[test]
    fn nothing_is_repeated_or_loaded() {
        refused(
            &world(r#"<replicate count="100000000"><geom size="1"/></replicate>"#),
            &["line 2", "<replicate>"],
        );
        refused(&world(r#"<composite count="9 9 9"/>"#), &["<composite>"]);
        refused(&world(r#"<body><flexcomp name="f"/></body>"#), &["<flexcomp name=\"f\">"]);
        refused(
            "<mujoco><extension><plugin plugin='a.b'/></extension></mujoco>",
            &["<extension>", "<plugin>"],
        );
        refused("<!DOCTYPE a [<!ENTITY b \"c\">]><mujoco>&b;</mujoco>", &["no MJCF"]);
    }

    #[test]
    fn time_and_memory_are_bounded() {
        let option = |attribute: &str| format!("<mujoco><option {attribute}/></mujoco>");
        for value in ["0", "-0.01", "nan", "inf", "1e999", "0x1p-8", "1", ""] {
            let result = check(&option(&format!("timestep=\"{value}\"")));
            // Nothing at all is left to the parsers, which refuse it or take their default.
            assert_eq!(result.is_err(), !value.is_empty(), "{value}: {result:?}");
        }
        refused(&option("iterations=\"2000000000\""), &["<option>", "iterations", "1000"]);
        refused(&option("gravity=\"0 0 NaN\""), &["gravity", "NaN"]);
        for memory in ["1T", "1e30", "512M", "nan"] {
            refused(&format!("<mujoco><size memory=\"{memory}\"/></mujoco>"), &["<size>", "memory"]);
        }
        assert_eq!(check("<mujoco><size memory=\"64M\"/></mujoco>"), Ok(()));
        refused(&world(r#"<body name="b" pos="0 0 1e11"/>"#), &["<body name=\"b\">", "1e10"]);
    }

    #[test]
    fn depth_and_count_are_bounded() {
        let nested = |n: usize| world(&("<body>".repeat(n) + &"</body>".repeat(n)));
        assert_eq!(check(&nested(MAX_DEPTH - 2)), Ok(()));
        refused(&nested(MAX_DEPTH - 1), &["inside one another"]);
        refused(&nested(70_000), &["inside one another"]);
        // What only looks like a tag does not count.
        let light = |n: usize| format!("<!-- <a> --><?b <a> ?><light dir='0 0 1' name='>&lt;{n}'/>");
        let hidden: String = (0..MAX_DEPTH).map(light).collect();
        assert_eq!(check(&world(&hidden)), Ok(()));
        refused(&world(&"<body/>".repeat(MAX_OF_A_KIND + 1)), &["at most 500"]);
        refused(&world(&"<camera/>".repeat(MAX_ELEMENTS)), &["at most 10000 elements"]);
        refused(&" ".repeat(MAX_BYTES + 1), &["bytes"]);
    }

    #[test]
    fn names_are_unique_and_classes_exist() {
        refused(&world("<body name='leg'/><body name='leg'/>"), &["<body", "called `leg` too"]);
        refused(&world("<body childclass='steel'/>"), &["childclass=\"steel\"", "no <default>"]);
        let known = "<mujoco><default><default class='steel'/></default><worldbody><body childclass='steel'/>\
                     <geom name='leg' class='main'/></worldbody></mujoco>";
        assert_eq!(check(known), Ok(()));
    }

    #[test]
    fn other_texts_are_refused_with_few_words() {
        refused(
            "<robot name='urdf'><link name='a'/></robot>",
            &["<robot name=\"urdf\">", "expected <mujoco>"],
        );
        refused("MJB\u{1}\u{0}", &["no MJCF"]);
        let many = check(&world(&"<mesh/>".repeat(100))).unwrap_err();
        assert_eq!(many.len(), MAX_FAULTS);
    }
}
