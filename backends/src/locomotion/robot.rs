//! Which robot, and what besides its MJCF file a locomotion task needs to know about it.

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use elo_core::fault::{Faults, meant};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::model::RobotModel;
use super::prescan;

/// An MJCF file and what it does not say.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RobotDescription {
    /// Options of one robot are refused by robots with another name.
    pub name: String,
    /// Path of the MJCF file, relative to the config; or the file's text itself (anything that begins with `<`), which is
    /// what a run stores. Only primitive geoms, hinges, slides, one free or planar root and `<motor>`s on joints; no
    /// other file, mesh, height field, texture or plugin.
    pub mjcf: String,
    /// The body whose height, velocity and orientation are observed.
    pub torso: String,
    /// Bodies whose floor contact is observed, in the order of the observation.
    pub feet: Vec<String>,
    /// Multiplies every motor's gear, so that torque = gear · torque_scale · clamped action, in N m.
    #[serde(default = "one")]
    #[schemars(range(min = 0.0))]
    pub torque_scale: f64,
    /// The standard reset puts every actuated joint uniformly within this distance (rad) of the file's pose.
    /// Roboschool's value is 0.1.
    #[serde(default = "tenth")]
    #[schemars(range(min = 0.0))]
    pub reset_noise: f64,
    /// Engine steps (the file's `timestep`) in one control step. Roboschool's value is 4.
    #[serde(default = "four")]
    #[schemars(range(min = 1, max = 1000))]
    pub substeps: u32,
    /// When the robot counts as standing; the default is always.
    #[serde(default)]
    pub alive: AliveRule,
    /// The points whose mean forward speed is the progress. Default: the frames of all bodies but the torso, equally.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub progress: Vec<ProgressPoint>,
}

/// The robot stands while all of this holds.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AliveRule {
    /// The height of the torso's centre of mass is above this, in m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min_height: Option<f64>,
    /// The torso's pitch is less than this to either side, in rad.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_pitch: Option<f64>,
    /// None of these bodies touched the floor at the end of the previous control step.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub no_floor_contact: Vec<String>,
}

/// One of the points whose weighted mean position counts as where the robot is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ProgressPoint {
    /// A body.
    pub body: String,
    /// The point in the body's frame, in m.
    #[serde(default)]
    pub offset: [f64; 3],
    /// How much it counts.
    #[serde(default = "one")]
    #[schemars(range(min = 0.0))]
    pub weight: f64,
}

fn one() -> f64 {
    1.0
}

fn tenth() -> f64 {
    0.1
}

fn four() -> u32 {
    4
}

/// The robots that configs can name.
pub const NAMES: [&str; 3] = ["ant", "half-cheetah", "walker2d"];

/// The built-in robot called `name`.
pub fn built_in(name: &str) -> Option<RobotDescription> {
    match name {
        "ant" => Some(ant()),
        "half-cheetah" => Some(half_cheetah()),
        "walker2d" => Some(walker2d()),
        _ => None,
    }
}

fn points<'a>(list: impl IntoIterator<Item = (&'a str, [f64; 3], f64)>) -> Vec<ProgressPoint> {
    list.into_iter()
        .map(|(body, offset, weight)| ProgressPoint { body: body.to_owned(), offset, weight })
        .collect()
}

fn names(list: &[&str]) -> Vec<String> {
    list.iter().map(|&name| name.to_owned()).collect()
}

fn roboschool(name: &str, mjcf: &str, feet: &[&str]) -> RobotDescription {
    RobotDescription {
        name: name.to_owned(),
        mjcf: mjcf.to_owned(),
        torso: "torso".to_owned(),
        feet: names(feet),
        torque_scale: 1.0,
        reset_noise: 0.1,
        substeps: 4,
        alive: AliveRule::default(),
        progress: Vec::new(),
    }
}

/// Progress points: Roboschool averages the centres of 4 legs, 4 aux links and 4 feet and the 8 joint pivots. The legs'
/// centres and the hips' pivots are fixed to the torso and symmetric about its origin, which therefore counts 8 times.
fn ant() -> RobotDescription {
    const LEGS: [(&str, &str, f64, f64); 4] = [
        ("aux_1", "front_left_foot", 1.0, 1.0),
        ("aux_2", "front_right_foot", -1.0, 1.0),
        ("aux_3", "left_back_foot", -1.0, -1.0),
        ("aux_4", "right_back_foot", 1.0, -1.0),
    ];
    let leg_points = LEGS.iter().flat_map(|&(aux, foot, x, y)| {
        [(aux, [0.1 * x, 0.1 * y, 0.0], 1.0), (foot, [0.0; 3], 1.0), (foot, [0.2 * x, 0.2 * y, 0.0], 1.0)]
    });
    RobotDescription {
        alive: AliveRule { min_height: Some(0.26), ..AliveRule::default() },
        progress: points([("torso", [0.0; 3], 8.0)].into_iter().chain(leg_points)),
        ..roboschool("ant", include_str!("robots/ant.xml"), &LEGS.map(|leg| leg.1))
    }
}

/// Progress points: the torso's centre counts 4 times (three massless root links share its x), each leg joint twice (its
/// pivot, and the link's centre of mass, which is there too).
fn half_cheetah() -> RobotDescription {
    let feet = ["ffoot", "fshin", "fthigh", "bfoot", "bshin", "bthigh"];
    let leg_points = feet.map(|body| (body, [0.0; 3], 2.0));
    RobotDescription {
        alive: AliveRule {
            min_height: None,
            max_pitch: Some(1.0),
            no_floor_contact: names(&["fshin", "fthigh", "bshin", "bthigh"]),
        },
        progress: points([("torso", [0.0; 3], 4.0)].into_iter().chain(leg_points)),
        ..roboschool("half-cheetah", include_str!("robots/half-cheetah.xml"), &feet)
    }
}

/// Progress points: three massless root links at the root's pivot (the torso's frame), the torso's centre of mass, and
/// for each leg link its pivot and its centre of mass.
fn walker2d() -> RobotDescription {
    let centres = [
        ("thigh", [0.0, 0.0, -0.225]),
        ("leg", [0.0, 0.0, -0.25]),
        ("foot", [0.1, 0.0, 0.0]),
        ("thigh_left", [0.0, 0.0, -0.225]),
        ("leg_left", [0.0, 0.0, -0.25]),
        ("foot_left", [0.1, 0.0, 0.0]),
    ];
    let leg_points = centres.iter().flat_map(|&(body, centre)| [(body, [0.0; 3], 1.0), (body, centre, 1.0)]);
    let torso_points = [("torso", [0.0; 3], 3.0), ("torso", [0.0, 0.0, 1.25], 1.0)];
    RobotDescription {
        alive: AliveRule { min_height: Some(0.8), max_pitch: Some(1.0), no_floor_contact: Vec::new() },
        progress: points(torso_points.into_iter().chain(leg_points)),
        ..roboschool("walker2d", include_str!("robots/walker2d.xml"), &["foot", "foot_left"])
    }
}

/// The robot that a simulator config's two fields choose.
///
/// # Errors
/// Neither or both fields set, an unknown name, or a description that [`RobotModel::load`] refuses.
pub fn chosen(robot: Option<&str>, own_robot: Option<&RobotDescription>) -> Result<RobotModel, String> {
    match (robot, own_robot) {
        (Some(name), None) => loaded(&built_in(name).ok_or_else(|| unknown(name))?),
        (None, Some(own)) => loaded(own),
        (None, None) => Err(format!("expected `robot` (one of {}) or `own_robot`", NAMES.join(", "))),
        (Some(_), Some(_)) => Err("expected `robot` or `own_robot`, got both".to_owned()),
    }
}

/// Reports what [`chosen`] would refuse, at the field that is to blame.
pub fn validate(robot: Option<&str>, own_robot: Option<&RobotDescription>, faults: &mut Faults) {
    match (robot, own_robot) {
        (Some(name), None) => faults.check(built_in(name).is_some(), "robot", || unknown(name)),
        (None, Some(own)) => faults.within("own_robot", |faults| {
            for fault in RobotModel::load(own).err().into_iter().flatten() {
                faults.add(&fault.path, fault.message);
            }
        }),
        _ => {
            if let Err(fault) = chosen(robot, own_robot) {
                faults.add("robot", fault);
            }
        }
    }
}

fn loaded(description: &RobotDescription) -> Result<RobotModel, String> {
    RobotModel::load(description).map_err(|faults| {
        let sentences: Vec<String> = faults.iter().map(ToString::to_string).collect();
        sentences.join("; ")
    })
}

fn unknown(name: &str) -> String {
    let meant = meant(name, NAMES, '`');
    format!("`{name}` is no robot (expected one of {}){meant}", NAMES.join(", "))
}

impl RobotDescription {
    /// Replaces the path in `mjcf` by the checked text of the file; a text is checked as it is.
    pub fn embed(&mut self, folder: &Path, faults: &mut Faults) {
        if prescan::is_text(&self.mjcf) {
            return;
        }
        match read_regular(&folder.join(&self.mjcf)) {
            Ok(text) => self.mjcf = text,
            Err(fault) => faults.add("mjcf", format!("cannot read `{}`: {fault}", self.mjcf)),
        }
    }
}

/// Reads a regular file of at most [`prescan::MAX_BYTES`]; a pipe or device would block or never end.
fn read_regular(path: &Path) -> Result<String, String> {
    let regular = |meta: std::fs::Metadata| {
        if meta.is_file() { Ok(()) } else { Err("it is no regular file".to_owned()) }
    };
    regular(std::fs::metadata(path).map_err(|e| e.to_string())?)?;
    let file = File::open(path).map_err(|e| e.to_string())?;
    regular(file.metadata().map_err(|e| e.to_string())?)?;
    let mut text = String::new();
    file.take(prescan::MAX_BYTES as u64 + 1).read_to_string(&mut text).map_err(|e| e.to_string())?;
    if text.len() > prescan::MAX_BYTES {
        return Err(format!("it is larger than {} bytes", prescan::MAX_BYTES));
    }
    if !prescan::is_text(&text) {
        return Err("it does not begin with `<`".to_owned());
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn progress_points_have_roboschools_weights() {
        for (name, links) in NAMES.into_iter().zip([20.0, 16.0, 16.0]) {
            let robot = built_in(name).unwrap();
            assert_eq!(robot.progress.iter().map(|point| point.weight).sum::<f64>(), links, "{name}");
        }
    }

    #[test]
    fn a_description_needs_little_and_knows_its_fields() {
        let text = r#"{"name": "mine", "mjcf": "mine.xml", "torso": "trunk", "feet": ["left", "right"]}"#;
        let mine: RobotDescription = serde_json::from_str(text).unwrap();
        assert_eq!((mine.torque_scale, mine.reset_noise, mine.substeps), (1.0, 0.1, 4));
        let slip = text.replace("feet", "foots");
        assert!(serde_json::from_str::<RobotDescription>(&slip).unwrap_err().to_string().contains("foots"));
    }

    #[test]
    fn every_fault_of_an_own_robot_is_reported_under_its_field() {
        let mut own = built_in("walker2d").unwrap();
        own.torso = "trso".to_owned();
        own.substeps = 0;
        own.reset_noise = f64::NAN;
        let mut faults = Faults::new();
        validate(None, Some(&own), &mut faults);
        let text: Vec<String> = faults.into_found().iter().map(ToString::to_string).collect();
        assert_eq!(
            text,
            [
                "`own_robot.torso`: the file has no body `trso`; did you mean `torso`?",
                "`own_robot.reset_noise`: expected 0 to 10, got NaN",
                "`own_robot.substeps`: expected 1 to 1000, got 0",
            ]
        );
    }
}
