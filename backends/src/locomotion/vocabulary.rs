//! The words that a robot's MJCF file may use: which attributes each element may have, and which values the attributes
//! that hold words. What is not here would be ignored by one engine and acted on by another, or is a slip of the pen.

use elo_core::fault::meant;

/// Where an element lies in its parent's frame.
const FRAME: &[&str] = &["pos", "quat", "axisangle", "xyaxes", "zaxis", "euler"];

/// Each element, its attributes, and whether it has those of [`FRAME`] too.
const ATTRIBUTES: [(&str, &[&str], bool); 15] = [
    ("mujoco", &["model"], false),
    (
        "compiler",
        &[
            "angle",
            "eulerseq",
            "autolimits",
            "inertiafromgeom",
            "inertiagrouprange",
            "settotalmass",
            "boundmass",
            "boundinertia",
            "balanceinertia",
        ],
        false,
    ),
    (
        "option",
        &[
            "timestep",
            "gravity",
            "integrator",
            "cone",
            "jacobian",
            "solver",
            "iterations",
            "tolerance",
            "ls_iterations",
            "ls_tolerance",
            "noslip_iterations",
            "noslip_tolerance",
            "ccd_iterations",
            "ccd_tolerance",
            "impratio",
        ],
        false,
    ),
    ("size", &["njmax", "nconmax", "nstack", "memory", "nkey"], false),
    ("default", &["class"], false),
    ("worldbody", &[], false),
    ("body", &["name", "childclass", "gravcomp", "mocap"], true),
    ("inertial", &["mass", "diaginertia", "fullinertia"], true),
    (
        "joint",
        &[
            "name",
            "class",
            "type",
            "group",
            "axis",
            "pos",
            "range",
            "limited",
            "damping",
            "stiffness",
            "springref",
            "springdamper",
            "armature",
            "frictionloss",
            "ref",
            "margin",
            "solreflimit",
            "solimplimit",
            "solreffriction",
            "solimpfriction",
        ],
        false,
    ),
    ("freejoint", &["name", "group", "align"], false),
    (
        "geom",
        &[
            "name",
            "class",
            "type",
            "group",
            "size",
            "fromto",
            "mass",
            "density",
            "friction",
            "contype",
            "conaffinity",
            "condim",
            "priority",
            "margin",
            "gap",
            "solmix",
            "solref",
            "solimp",
            "rgba",
            "material",
        ],
        true,
    ),
    ("contact", &[], false),
    ("exclude", &["name", "class", "body1", "body2"], false),
    ("actuator", &[], false),
    ("motor", &["name", "class", "group", "joint", "gear", "ctrllimited", "ctrlrange"], false),
];

/// What attributes that hold one of a few words may say; element, attribute, words.
const CHOICES: [(&str, &str, &[&str]); 9] = [
    ("joint", "type", &["hinge", "slide", "ball", "free"]),
    ("geom", "type", &["plane", "sphere", "capsule", "ellipsoid", "cylinder", "box"]),
    ("compiler", "angle", &["radian", "degree"]),
    ("compiler", "inertiafromgeom", &["true", "false", "auto"]),
    ("option", "integrator", &["Euler", "RK4", "implicit", "implicitfast"]),
    ("option", "cone", &["pyramidal", "elliptic"]),
    ("option", "solver", &["PGS", "CG", "Newton"]),
    ("joint", "limited", &["true", "false", "auto"]),
    ("motor", "ctrllimited", &["true", "false", "auto"]),
];

/// Checks that `element` may have this attribute with this value. Elements without a list are for the eye alone, and
/// may have what they like.
///
/// # Errors
/// What is wrong, with the nearest word.
pub fn check(element: &str, attribute: &str, value: &str) -> Result<(), String> {
    if let Some((_, own, framed)) = ATTRIBUTES.iter().find(|(name, ..)| *name == element) {
        let known = || own.iter().chain(FRAME.iter().filter(|_| *framed)).copied();
        if !known().any(|name| name == attribute) {
            return Err(format!("this attribute is not supported{}", meant(attribute, known(), '`')));
        }
    }
    let choice = CHOICES.iter().find(|(owner, name, _)| (*owner, *name) == (element, attribute));
    match choice {
        Some((.., words)) if !words.contains(&value) => {
            let meant = meant(value, words.iter().copied(), '`');
            Err(format!("expected one of {}{meant}", words.join(", ")))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_and_what_one_engine_would_ignore_are_refused() {
        assert_eq!(check("joint", "damping", "1"), Ok(()));
        assert_eq!(check("geom", "axisangle", "0 1 0 1"), Ok(()));
        assert_eq!(check("light", "diffuse", "1 1 1"), Ok(()));
        let slip = check("joint", "dampping", "1");
        assert_eq!(slip, Err("this attribute is not supported; did you mean `damping`?".to_owned()));
        for (element, attribute) in [("option", "wind"), ("motor", "forcerange"), ("joint", "quat")] {
            assert!(check(element, attribute, "1").is_err(), "{element} {attribute}");
        }
        assert!(check("option", "integrator", "foo").is_err());
        assert!(check("joint", "type", "hindge").is_err_and(|why| why.ends_with("did you mean `hinge`?")));
    }
}
