//! What an MJCF file may not contain here. An element that would change the motion is refused by name, never ignored.
//!
//! Two things cannot be seen, because the parser drops them: spatial tendons, and the softness of contacts and limits
//! (`solref`, `solimp`).

use mjcf_rs::Model;
use mjcf_rs::body::{Geom, Joint, JointType};
use mjcf_rs::extras::ActuatorKind;

/// Refuses the first element that this engine cannot represent.
pub(super) fn refuse(model: &Model) -> Result<(), String> {
    let no = |what: &str| Err(format!("{what} not supported by this engine"));
    if !model.equality.is_empty() {
        return no("`<equality>` constraints are");
    }
    if let Some(tendon) = model.tendons.first() {
        return no(&format!("tendon `{}` is", tendon.name.as_deref().unwrap_or("without name")));
    }
    if !model.contact.pairs.is_empty() || !model.contact.excludes.is_empty() {
        return no("`<contact>` pairs and excludes (use `contype` and `conaffinity`) are");
    }
    if model.compiler.bound_mass > 0.0 || model.compiler.bound_inertia > 0.0 || model.compiler.balance_inertia
    {
        return no("`<compiler>` boundmass, boundinertia and balanceinertia are");
    }
    for (index, actuator) in model.actuators.iter().enumerate() {
        if actuator.kind != ActuatorKind::Motor {
            let label = actuator.name.clone().unwrap_or_else(|| index.to_string());
            return no(&format!("actuator `{label}` of kind {:?} (use `<motor>`) is", actuator.kind));
        }
    }
    for (id, entry) in model.bodies.iter().enumerate() {
        let body = &entry.body;
        let inside = |what: String| {
            let owner = body.name.clone().unwrap_or_else(|| id.to_string());
            Err(format!("body `{owner}`: {what} not supported by this engine"))
        };
        if body.mocap || body.gravcomp != 0.0 {
            return inside("mocap and gravcomp are".to_owned());
        }
        let free = body.joints.iter().any(|j| j.type_ == JointType::Free);
        if free && (body.joints.len() > 1 || entry.parent != Some(0)) {
            return inside("a free joint below another joint or body is".to_owned());
        }
        if let Some(what) = body.joints.iter().find_map(refused_joint) {
            return inside(what);
        }
        let collides = |g: &&Geom| g.contype != 0 || g.conaffinity != 0;
        if let Some(what) = body.geoms.iter().filter(collides).find_map(refused_geom) {
            return inside(what);
        }
    }
    Ok(())
}

fn refused_joint(joint: &Joint) -> Option<String> {
    let label = joint.name.as_deref().unwrap_or("without name");
    let free = joint.type_ == JointType::Free;
    if joint.springdamper.is_some() || joint.margin != 0.0 {
        Some(format!("springdamper and margin of joint `{label}` are"))
    } else if free && (joint.damping != 0.0 || joint.armature != 0.0 || joint.frictionloss != 0.0) {
        Some(format!("damping, armature and frictionloss of the free joint `{label}` are"))
    } else {
        None
    }
}

fn refused_geom(geom: &Geom) -> Option<String> {
    let label = geom.name.as_deref().unwrap_or("without name");
    if geom.condim != 3 {
        Some(format!("condim {} of geom `{label}` (only 3) is", geom.condim))
    } else if geom.margin != 0.0 || geom.priority != 0 {
        Some(format!("margin and priority of geom `{label}` are"))
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn every_refusal_names_its_element() {
        let hinge = r#"<worldbody><body name="leg"><joint name="knee" EXTRA/>
            <geom name="sole" size="1" GEOM/></body></worldbody>"#;
        let plain = hinge.replace(" EXTRA", "").replace(" GEOM", "");
        let cases = [
            (format!("{plain}<equality><joint joint1=\"knee\" joint2=\"knee\"/></equality>"), "equality"),
            (
                format!(
                    "{plain}<tendon><fixed name=\"cord\"><joint joint=\"knee\" coef=\"1\"/></fixed></tendon>"
                ),
                "cord",
            ),
            (format!("{plain}<actuator><position name=\"servo\" joint=\"knee\"/></actuator>"), "servo"),
            (format!("{plain}<contact><exclude body1=\"leg\" body2=\"leg\"/></contact>"), "contact"),
            (format!("<compiler boundmass=\"14\"/>{plain}"), "boundmass"),
            (hinge.replace("EXTRA", "margin=\"0.1\"").replace(" GEOM", ""), "knee"),
            (hinge.replace(" EXTRA", "").replace("GEOM", "condim=\"6\""), "sole"),
            (plain.replace("<joint name=\"knee\"/>", "<joint name=\"knee\"/><freejoint/>"), "free"),
        ];
        assert!(refuse(&Model::from_str(&format!("<mujoco>{plain}</mujoco>"), ".").unwrap()).is_ok());
        for (inside, named) in cases {
            let model = Model::from_str(&format!("<mujoco>{inside}</mujoco>"), ".").unwrap();
            let error = refuse(&model).expect_err(named);
            assert!(error.contains(named), "{error} does not name {named}");
        }
    }
}
