//! What every backend's simulator of the three robots must do, through the public interface alone. A backend adds its
//! entry to `subjects`.

#![cfg(any(feature = "mujoco", feature = "rapier"))]
#![allow(clippy::unwrap_used, missing_docs)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use elo_backends::locomotion::robot::{NAMES, built_in};
use elo_core::conformance::simulator::{Case, Tolerance, run};
use elo_core::context::{Context, PreparedStart};
use elo_core::policy::Unwatched;
use elo_core::rollout::Horizon;
use elo_core::seed::Seed;
use elo_core::simulator::{SimulatorConfig, Start};
use elo_core::task::Task;
use elo_core::units::evaluate::{self, Behavior, Evaluate};
use elo_core::units::film::{Film, Filmed};
use elo_core::units::play::Play;
use elo_core::units::{Site, Work, prepare};

/// A simulator to be tried.
struct Subject {
    config: Box<dyn SimulatorConfig>,
    /// How exactly it takes up a state.
    tolerance: Tolerance,
    /// Whether a step, the engine's part included, must allocate nothing.
    allocates_nothing: bool,
}

/// Every engine of this build with every robot.
fn subjects() -> Vec<Subject> {
    let mut subjects = Vec::new();
    for name in NAMES {
        #[cfg(feature = "mujoco")]
        subjects.push(Subject {
            config: Box::new(elo_backends::mujoco::MujocoConfig {
                robot: Some(name.to_owned()),
                own_robot: None,
            }),
            // The solver of a run begins from its last solution, that of a restored state from none.
            tolerance: Tolerance { start: 1e-9, step: 1e-5 },
            allocates_nothing: true,
        });
        #[cfg(feature = "rapier")]
        subjects.push(Subject {
            config: Box::new(elo_backends::rapier::RapierConfig {
                robot: Some(name.to_owned()),
                ..Default::default()
            }),
            tolerance: Tolerance { start: 1e-9, step: 1e-6 },
            // The engine itself does.
            allocates_nothing: false,
        });
    }
    subjects
}

#[test]
fn every_simulator_keeps_the_contract() {
    let reports = subjects().into_iter().map(|subject| {
        let case = Case::new(subject.config).within(subject.tolerance);
        run(&if subject.allocates_nothing { case.counting(|| ALLOCATIONS.get()) } else { case })
    });
    let broken: Vec<String> =
        reports.filter(|report| !report.failed().is_empty()).map(|report| report.to_string()).collect();
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

#[test]
fn the_standard_pose_is_seen_as_roboschool_sees_it() {
    let heights = [("ant", 0.75), ("half-cheetah", 0.7), ("walker2d", 1.25)];
    for subject in subjects() {
        let mut simulator = subject.config.build().unwrap();
        let spec = simulator.spec().clone();
        let (robot, actuated) = (spec.robot.as_str(), spec.action_size());
        let mut observation = vec![0.0; spec.observation_size];
        simulator.reset(&Task::default(), &Start::Seed(3), &mut observation).unwrap();
        let state = simulator.state().unwrap();
        let height = heights.iter().find(|(name, _)| *name == robot).unwrap().1;
        assert!((state.memory[0] - height).abs() < 1e-9, "{robot}: z0 is {}", state.memory[0]);
        let (torso, joints) = observation.split_at(8);
        // Joint noise moves the mean place by some millimetres, seen from a target a kilometre away.
        let expected = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        assert!(
            torso.iter().zip(expected).all(|(a, b): (&f32, f32)| (a - b).abs() < 1e-4),
            "{robot}: {torso:?}"
        );
        assert!(joints[..2 * actuated].iter().skip(1).step_by(2).all(|&speed| speed == 0.0), "{robot}");
        assert!(joints[2 * actuated..].iter().all(|&contact| contact == 0.0), "{robot}");
        // The first joint lies where its coordinate says: hip_1's range is symmetric, bthigh's and thigh's are not.
        let q = state.positions[state.positions.len() - actuated];
        let (low, high) = match robot {
            "ant" => (-40_f64.to_radians(), 40_f64.to_radians()),
            "half-cheetah" => (-0.52, 1.05),
            _ => (-150_f64.to_radians(), 0.0),
        };
        let expected = (2.0 * q - low - high) / (high - low);
        assert!((f64::from(joints[0]) - expected).abs() < 1e-6, "{robot}: {} {expected}", joints[0]);
        let limits: f64 = if robot == "ant" { 4.0 } else { 1.0 };
        let mut terms = [0.0; 6];
        simulator.step(&vec![0.0; actuated], &mut observation, &mut terms).unwrap();
        assert!(terms[4] >= limits, "{robot}: {terms:?}: ankles and ffoot start outside");
    }
}

#[test]
fn films_show_every_geom_and_a_torso_that_moves() {
    for Subject { config, .. } in subjects() {
        let spec = config.spec().unwrap();
        let robot = spec.robot.as_str();
        let context = Context { task: Task::default(), start: PreparedStart::standard(4) };
        let subject = evaluate::Subject { name: "random".to_owned(), behavior: Behavior::RandomTorque };
        let horizon = Horizon { steps: 40, discount: 1.0, stop_at_fall: false };
        let play = Play { simulator: config, subjects: vec![subject], horizon, seed: Seed::root(1) };
        let rollouts = Evaluate { contexts: 1, play };
        let work = Work::from(Film { rollouts, first: 1 });
        let bytes = work.perform(&[prepare::encode(&[context])], &mut Site::new(Vec::new()), &mut Unwatched);
        let Filmed { scene, takes } = Filmed::decode(&bytes.unwrap()).unwrap();
        let (scene, take) = (scene.unwrap(), &takes[0]);
        let text = built_in(robot).unwrap().mjcf;
        assert_eq!(scene.solids.len(), text.matches("<geom name=").count() - 1, "{robot}: all but the floor");
        let torso = scene.bodies.iter().position(|body| body == "torso").unwrap();
        assert_eq!(take.steps.len(), 41, "{robot}");
        let places: Vec<f64> = take.steps.iter().map(|poses| poses[torso].position[0]).collect();
        assert!(places.windows(2).all(|two| two[0] != two[1]), "{robot}: {places:?}");
        assert_eq!(places[0], 0.0, "{robot}");
    }
}

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

/// Counts what the calling thread allocates.
struct Counting;

// SAFETY: hands every call on to the system's allocator as it is.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // A thread that is ending has no counter any more, and nothing to count.
        let _ = ALLOCATIONS.try_with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promises are those that the system's allocator asks for.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;
