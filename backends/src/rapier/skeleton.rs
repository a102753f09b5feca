//! From an MJCF file to links: what moves as one, the joints between, and where MuJoCo's coordinates go.
//!
//! Cost is proportional to links, so there are as few as possible: bodies without joints are part of their parent's
//! link, and slides followed by a hinge on one body (a planar root) are one joint of several freedoms. Joints that fit
//! into no such joint follow each other with massless links between.

use mjcf_rs::glam::DVec3;
use mjcf_rs::{Model, Pose};

use super::inertia::Inertia;
use super::segment::Segment;
use super::shape::{Form, Shape};
use super::unsupported;

/// A robot as the engine needs it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Skeleton {
    /// Parents come before their children.
    pub links: Vec<Link>,
    /// The file's bodies in its order, without the world.
    pub places: Vec<Place>,
    /// The file's actuators in its order.
    pub motors: Vec<Motor>,
    /// The world's geoms.
    pub obstacles: Vec<Shape>,
    /// m/s².
    pub gravity: DVec3,
    /// Lengths of MuJoCo's `qpos` and `qvel`.
    pub sizes: Sizes,
}

/// Lengths of MuJoCo's coordinate vectors.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Sizes {
    pub positions: usize,
    pub velocities: usize,
}

/// What moves as one, and how it hangs on its parent.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Link {
    /// None: the world.
    pub parent: Option<usize>,
    /// The joint's frame on the parent.
    pub frame_on_parent: Pose,
    /// The same frame on this link, at zero coordinates. (For a free link only its rotation is meant: the engine's
    /// builder moves it to the centre of mass, which a payload may shift.)
    pub frame: Pose,
    pub freedoms: Freedoms,
    /// In the link's frame, which is that of its first body.
    pub inertia: Inertia,
    pub shapes: Vec<Shape>,
}

/// What the joint above a link leaves free.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Freedoms {
    /// Everything. Its coordinates start here in MuJoCo's vectors.
    Free(Sizes),
    /// Along and about axes of the joint's frame.
    Axes(Vec<Freedom>),
}

/// One hinge or slide of the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Freedom {
    /// 0 to 2: slides along x, y, z of the joint's frame; 3 to 5: turns about them.
    pub axis: usize,
    /// -1 where the file's axis points the other way.
    pub sign: f64,
    /// Where it stands in MuJoCo's vectors.
    pub place: Sizes,
    /// MuJoCo's position at which the engine's coordinate is zero.
    pub reference: f64,
    /// Least and greatest of MuJoCo's position.
    pub range: Option<[f64; 2]>,
    /// N m/rad or N/m.
    pub stiffness: f64,
    /// MuJoCo's position at which the spring rests.
    pub spring_rest: f64,
    /// N m s/rad or N s/m.
    pub damping: f64,
    /// kg m² or kg.
    pub armature: f64,
    /// Dry friction, N m or N.
    pub friction: f64,
}

/// Where a body is.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Place {
    pub name: String,
    /// None: fixed to the world.
    pub link: Option<usize>,
    /// The body's frame on the link (or in the world).
    pub pose: Pose,
    /// The body's own centre of mass, in its own frame.
    pub centre: DVec3,
}

/// An actuator: which joint it drives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Motor {
    pub link: usize,
    pub freedom: Freedom,
}

impl Skeleton {
    /// Reads the file's tree.
    ///
    /// # Errors
    /// The first element that this engine cannot represent, by name.
    pub fn of(model: &Model) -> Result<Self, String> {
        unsupported::refuse(model)?;
        let mut this = Self {
            links: Vec::new(),
            places: Vec::new(),
            motors: Vec::new(),
            obstacles: Vec::new(),
            gravity: DVec3::from_array(model.option.gravity),
            sizes: Sizes::default(),
        };
        let mut joints = Vec::new();
        for id in 0..model.bodies.len() {
            this.add_body(model, id, &mut joints).map_err(|e| format!("body `{}`: {e}", name(model, id)))?;
        }
        if this.links.is_empty() {
            return Err("no body has a joint: nothing can move".to_owned());
        }
        if model.compiler.set_total_mass > 0.0 {
            let total: f64 = this.links.iter().map(|link| link.inertia.mass).sum();
            let scale = model.compiler.set_total_mass / total;
            for link in &mut this.links {
                link.inertia = link.inertia.scaled(scale);
            }
        }
        for place in &this.places {
            if place.link.is_some_and(|link| !this.links[link].inertia.is_solid()) {
                return Err(format!("body `{}` can move but has no mass or no inertia", place.name));
            }
        }
        for (index, actuator) in model.actuators.iter().enumerate() {
            let motor = joints.iter().find(|(name, _)| actuator.joint.is_some() && *name == actuator.joint);
            let label = actuator.name.clone().unwrap_or_else(|| index.to_string());
            let Some((_, motor)) = motor else {
                return Err(format!("actuator `{label}` drives no hinge or slide of the file"));
            };
            this.motors.push(*motor);
        }
        Ok(this)
    }

    fn add_body(
        &mut self,
        model: &Model,
        id: usize,
        joints: &mut Vec<(Option<String>, Motor)>,
    ) -> Result<(), String> {
        let entry = &model.bodies[id];
        let body = &entry.body;
        let inertia = if id == 0 { Inertia::NONE } else { Inertia::of_body(body, model)? };
        let (mut link, mut pose) = match entry.parent {
            None => (None, Pose::IDENTITY),
            // The world is body 0 and has no place.
            Some(0) => (None, body.pose),
            Some(parent) => {
                let place = &self.places[parent - 1];
                (place.link, place.pose * body.pose)
            }
        };
        for segment in Segment::of(&body.joints)? {
            let freedoms = self.coordinates(&segment, model.compiler.autolimits);
            self.links.push(Link {
                parent: link,
                frame_on_parent: if segment.free { Pose::IDENTITY } else { pose * segment.frame },
                frame: segment.frame,
                freedoms,
                inertia: Inertia::NONE,
                shapes: Vec::new(),
            });
            let here = self.links.len() - 1;
            if let Freedoms::Axes(axes) = &self.links[here].freedoms {
                for (freedom, joint) in axes.iter().zip(&segment.joints) {
                    joints.push((joint.name.clone(), Motor { link: here, freedom: *freedom }));
                }
            }
            (link, pose) = (Some(here), Pose::IDENTITY);
        }
        for geom in body.geoms.iter().filter(|g| g.contype != 0 || g.conaffinity != 0) {
            let label = || geom.name.clone().unwrap_or_else(|| format!("{:?}", geom.type_));
            let (form, at) = Form::of_geom(geom).map_err(|e| format!("geom `{}`: {e}", label()))?;
            if form == Form::Plane && link.is_some() {
                return Err(format!("geom `{}`: a plane must belong to the world", label()));
            }
            let shape = Shape {
                body: id.saturating_sub(1),
                pose: pose * at,
                form,
                friction: geom.friction[0],
                contype: geom.contype,
                conaffinity: geom.conaffinity,
            };
            match link {
                None => self.obstacles.push(shape),
                Some(link) => self.links[link].shapes.push(shape),
            }
        }
        if let Some(link) = link {
            let total = &mut self.links[link].inertia;
            *total = total.plus(&inertia.seen_from(pose));
        }
        if id != 0 {
            self.places.push(Place { name: name(model, id), link, pose, centre: inertia.centre });
        }
        Ok(())
    }

    /// Gives a joint's freedoms their places in MuJoCo's vectors.
    fn coordinates(&mut self, segment: &Segment<'_>, autolimits: bool) -> Freedoms {
        if segment.free {
            let place = self.sizes;
            self.sizes.positions += 7;
            self.sizes.velocities += 6;
            return Freedoms::Free(place);
        }
        let axes = segment.joints.iter().zip(&segment.axes).map(|(joint, (axis, sign))| {
            let place = self.sizes;
            self.sizes.positions += 1;
            self.sizes.velocities += 1;
            let limited = joint.limited.resolve(autolimits, joint.range.is_some());
            Freedom {
                axis: *axis,
                sign: *sign,
                place,
                reference: joint.ref_,
                range: joint.range.filter(|_| limited),
                stiffness: joint.stiffness,
                spring_rest: joint.springref,
                damping: joint.damping,
                armature: joint.armature,
                friction: joint.frictionloss,
            }
        });
        Freedoms::Axes(axes.collect())
    }
}

impl Freedom {
    /// The engine's coordinate at this position of MuJoCo's.
    pub fn inward(&self, position: f64) -> f64 {
        self.sign * (position - self.reference)
    }

    /// MuJoCo's position at this coordinate of the engine's.
    pub fn outward(&self, coordinate: f64) -> f64 {
        self.sign * coordinate + self.reference
    }
}

fn name(model: &Model, id: usize) -> String {
    model.bodies[id]
        .body
        .name
        .clone()
        .unwrap_or_else(|| if id == 0 { "world".into() } else { id.to_string() })
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn skeleton(xml: &str) -> Result<Skeleton, String> {
        Skeleton::of(&Model::from_str(xml, ".").unwrap())
    }

    #[test]
    fn bodies_without_joints_are_part_of_their_parent() {
        let robot = skeleton(
            r#"<mujoco><worldbody><body name="torso"><freejoint/>
                <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
                <body name="horn" pos="0 0 1"><inertial pos="0 0 1" mass="1" diaginertia="1 1 1"/>
                  <body name="tail" pos="1 0 0"><joint name="wag"/>
                    <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></body></body>
               </worldbody><actuator><motor joint="wag"/></actuator></mujoco>"#,
        )
        .unwrap();
        assert_eq!(robot.links.len(), 2);
        assert_eq!((robot.links[0].inertia.mass, robot.links[0].inertia.centre), (2.0, DVec3::Z));
        // Horn at z = 1, tail one further along x.
        assert_eq!(robot.links[1].frame_on_parent.translation, DVec3::new(1.0, 0.0, 1.0));
        assert_eq!((robot.places[1].link, robot.places[1].pose.translation), (Some(0), DVec3::Z));
        assert_eq!(robot.sizes, Sizes { positions: 8, velocities: 7 });
        assert_eq!((robot.motors[0].link, robot.motors[0].freedom.place.positions), (1, 7));
    }

    #[test]
    fn the_three_robots_have_as_few_links_as_possible() {
        let links = |xml| skeleton(xml).unwrap().links.len();
        assert_eq!(links(include_str!("../locomotion/robots/ant.xml")), 9);
        assert_eq!(links(include_str!("../locomotion/robots/half-cheetah.xml")), 7);
        assert_eq!(links(include_str!("../locomotion/robots/walker2d.xml")), 7);
    }

    #[test]
    fn a_missing_joint_of_an_actuator_is_named() {
        let error = skeleton(
            r#"<mujoco><worldbody><body><joint name="a"/><geom size="1"/></body></worldbody>
               <actuator><motor name="push" joint="b"/></actuator></mujoco>"#,
        )
        .unwrap_err();
        assert!(error.contains("push"), "{error}");
    }

    #[test]
    fn a_moving_body_without_mass_is_named() {
        let xml = r#"<mujoco><worldbody><body name="ghost"><joint/></body></worldbody></mujoco>"#;
        let error = skeleton(xml).unwrap_err();
        assert!(error.contains("ghost"), "{error}");
    }

    #[test]
    fn a_geom_of_an_unknown_type_is_named_with_its_body() {
        let error = skeleton(
            r#"<mujoco><worldbody><body name="leg"><joint/>
               <geom name="shell" type="cylinder" size="1 1"/></body></worldbody></mujoco>"#,
        )
        .unwrap_err();
        assert!(error.contains("leg") && error.contains("Cylinder"), "{error}");
    }
}
