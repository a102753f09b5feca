//! What is seen of a simulator.

use super::restore::points;
use super::trace::{Episode, begin};
use super::{Case, Check, Finding, Violation};
use crate::conformance::compare::{finite, granted, near, refused};
use crate::scene::{Pose, Scene, Shape};
use crate::simulator::{Simulator, Start};

pub(super) const SCENE_FOLLOWS_THE_STATE: Check<Case> = Check {
    name: "scene_follows_the_state",
    rule: "A scene is sound: its solids belong to its bodies and have sizes. After each step there is one finite pose with a \
           unit quaternion a body, and in an episode of random actions some body moves. An episode begun from a state \
           shows the poses of the run that it was read in, within the tolerance.",
    run: |case| {
        let mut simulator = case.simulator()?;
        let Some(visible) = simulator.visible() else {
            return Err(Finding::Skipped("it cannot be seen".to_owned()));
        };
        let scene = visible.scene();
        sound(&scene)?;
        refused("poses before the first reset", visible.poses())?;

        let episode = Episode::random(simulator.spec(), 1, case.steps);
        let settable = simulator.spec().capabilities.settable_state;
        let (mut seen, mut states) = (Vec::new(), Vec::new());
        let mut look = |step, simulator: &dyn Simulator| {
            seen.push(look(simulator, &scene).map_err(|v| v.at(step))?);
            if settable {
                states.push(granted("state", simulator.state()).map_err(|v| v.at(step))?);
            }
            Ok(())
        };
        let trace = episode.play_and(simulator.as_mut(), &mut look)?;
        look(trace.moments.len(), simulator.as_ref())?;
        if seen.iter().all(|poses| *poses == seen[0]) {
            return Err(
                Violation::new("poses in an episode of random actions", "some that differ", "none").into()
            );
        }
        for step in points(&trace).filter(|step| *step < states.len()) {
            begin(simulator.as_mut(), &episode.task, &Start::State(states[step].clone()))
                .map_err(|v| v.at(step))?;
            let again = look_again(simulator.as_ref(), &scene, &seen[step]).map_err(|v| v.at(step))?;
            let (expected, again) = (numbers(&seen[step]), numbers(&again));
            near("poses at the state", &expected, &again, case.tolerance.start).map_err(|v| v.at(step))?;
        }
        Ok(())
    },
};

/// Asks that solids name bodies, stand somewhere, and have sizes.
fn sound(scene: &Scene) -> Result<(), Violation> {
    if scene.bodies.is_empty() {
        return Err(Violation::new("bodies of the scene", "at least one", 0));
    }
    for (id, solid) in scene.solids.iter().enumerate() {
        let of = format!("solid {id}");
        if solid.body >= scene.bodies.len() {
            let expected = format!("less than {}", scene.bodies.len());
            return Err(Violation::new("body", expected, solid.body).during(of));
        }
        placed(&solid.pose).map_err(|v| v.during(&of))?;
        let sizes = match solid.shape {
            Shape::Sphere { radius } => [radius; 3],
            Shape::Capsule { radius, half_length } => [radius, half_length, half_length],
            Shape::Box { half_size } => half_size,
        };
        if let Some(size) = sizes.iter().find(|size| !(**size > 0.0 && size.is_finite())) {
            return Err(Violation::new("a size", "a positive number", size).during(of));
        }
    }
    Ok(())
}

/// One pose a body.
fn look(simulator: &dyn Simulator, scene: &Scene) -> Result<Vec<Pose>, Violation> {
    let seen = simulator.visible().ok_or_else(|| Violation::new("a scene", "as before", "none"))?;
    let poses = granted("poses", seen.poses())?;
    if poses.len() != scene.bodies.len() {
        return Err(Violation::new("number of poses", scene.bodies.len(), poses.len()));
    }
    for (pose, body) in poses.iter().zip(&scene.bodies) {
        placed(pose).map_err(|v| v.during(format!("body `{body}`")))?;
    }
    Ok(poses)
}

/// Poses with quaternions of the signs that they had in `before`, where they name the same rotations.
fn look_again(simulator: &dyn Simulator, scene: &Scene, before: &[Pose]) -> Result<Vec<Pose>, Violation> {
    let mut poses = look(simulator, scene)?;
    for (pose, before) in poses.iter_mut().zip(before) {
        let dot: f64 = pose.rotation.iter().zip(&before.rotation).map(|(a, b)| a * b).sum();
        pose.rotation = pose.rotation.map(|x| if dot < 0.0 { -x } else { x });
    }
    Ok(poses)
}

/// Asks for finite numbers and a unit quaternion.
fn placed(pose: &Pose) -> Result<(), Violation> {
    finite("pose", &pose.numbers())?;
    let length = pose.rotation.iter().map(|x| x * x).sum::<f64>().sqrt();
    if (length - 1.0).abs() < 1e-6 {
        Ok(())
    } else {
        Err(Violation::new("length of the quaternion", 1, length))
    }
}

fn numbers(poses: &[Pose]) -> Vec<f64> {
    poses.iter().flat_map(Pose::numbers).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use std::sync::atomic::{AtomicU32, Ordering};

    use super::*;
    use crate::conformance::point_mass::PointMassConfig;
    use crate::scene::Visible;
    use crate::simulator::{End, SimulatorConfig, SimulatorError, State};
    use crate::spec::SimulatorSpec;
    use crate::task::Task;

    type Fault = fn(&mut Scene, &mut Vec<Pose>);

    /// A point mass that is drawn wrongly, or not at all.
    struct Drawn(Box<dyn Simulator>, Option<Fault>);

    impl Simulator for Drawn {
        fn spec(&self) -> &SimulatorSpec {
            self.0.spec()
        }

        fn reset(&mut self, task: &Task, start: &Start, seen: &mut [f32]) -> Result<(), SimulatorError> {
            self.0.reset(task, start, seen)
        }

        fn step(
            &mut self,
            action: &[f32],
            seen: &mut [f32],
            terms: &mut [f64],
        ) -> Result<End, SimulatorError> {
            self.0.step(action, seen, terms)
        }

        fn state(&self) -> Result<State, SimulatorError> {
            self.0.state()
        }

        fn visible(&self) -> Option<&dyn Visible> {
            self.1.is_some().then_some(self)
        }
    }

    impl Drawn {
        fn wrong(&self, mut scene: Scene, mut poses: Vec<Pose>) -> (Scene, Vec<Pose>) {
            self.1.unwrap()(&mut scene, &mut poses);
            (scene, poses)
        }
    }

    impl Visible for Drawn {
        fn scene(&self) -> Scene {
            self.wrong(self.0.visible().unwrap().scene(), Vec::new()).0
        }

        fn poses(&self) -> Result<Vec<Pose>, SimulatorError> {
            let visible = self.0.visible().unwrap();
            Ok(self.wrong(visible.scene(), visible.poses()?).1)
        }
    }

    fn found(fault: Option<Fault>) -> Result<(), Finding> {
        let drawn = move |config: &dyn SimulatorConfig| {
            Ok(Box::new(Drawn(config.build()?, fault)) as Box<dyn Simulator>)
        };
        (SCENE_FOLLOWS_THE_STATE.run)(&Case::new(Box::new(PointMassConfig::default())).built_by(drawn))
    }

    #[test]
    fn every_fault_of_a_scene_is_named() {
        let faults: [(&str, Fault); 8] = [
            ("bodies of the scene", |scene, _| scene.bodies.clear()),
            ("solid 0: body", |scene, _| scene.solids[0].body = 1),
            ("solid 0: a size", |scene, _| scene.solids[0].shape = Shape::Box { half_size: [1.0, 0.0, 1.0] }),
            ("solid 0: length of the quaternion", |scene, _| scene.solids[0].pose.rotation[0] = 2.0),
            ("number of poses", |_, poses| poses.push(Pose::IDENTITY)),
            ("body `mass`: length of the quaternion", |_, poses| {
                poses.iter_mut().for_each(|p| p.rotation = [0.0; 4])
            }),
            ("body `mass`: pose[1]", |_, poses| poses.iter_mut().for_each(|p| p.position[1] = f64::NAN)),
            ("poses in an episode", |_, poses| poses.iter_mut().for_each(|p| p.position = [0.0; 3])),
        ];
        for (what, fault) in faults {
            let Err(Finding::Violation(violation)) = found(Some(fault)) else {
                panic!("{what} was not found")
            };
            assert!(violation.what.starts_with(what), "{what}: {violation}");
        }
    }

    #[test]
    fn a_rotation_has_two_quaternions_and_what_is_not_seen_is_not_tried() {
        // Every other look gives the other quaternion.
        static LOOKS: AtomicU32 = AtomicU32::new(0);
        let turned: Fault = |_, poses| {
            let sign = [1.0, -1.0][LOOKS.fetch_add(1, Ordering::Relaxed) as usize % 2];
            poses.iter_mut().for_each(|p| p.rotation[0] = sign);
        };
        assert_eq!(found(Some(turned)), Ok(()));
        assert!(matches!(found(None), Err(Finding::Skipped(_))));
    }
}
