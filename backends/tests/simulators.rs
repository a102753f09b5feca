//! What every backend's simulator of the three robots must do, through the public interface alone. A backend adds its line
//! to `configs`.

#![cfg(any(feature = "mujoco", feature = "rapier"))]
#![allow(clippy::unwrap_used, missing_docs)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use elo_backends::locomotion::robot::NAMES;
use elo_core::seed::Seed;
use elo_core::simulator::{End, Simulator, SimulatorConfig, Start};
use elo_core::task::Task;
use rand::RngExt as _;

/// Every engine of this build with every robot.
fn configs() -> Vec<Box<dyn SimulatorConfig>> {
    let mut configs: Vec<Box<dyn SimulatorConfig>> = Vec::new();
    for name in NAMES {
        #[cfg(feature = "mujoco")]
        configs.push(Box::new(elo_backends::mujoco::MujocoConfig {
            robot: Some(name.to_owned()),
            own_robot: None,
        }));
        #[cfg(feature = "rapier")]
        configs.push(Box::new(elo_backends::rapier::RapierConfig {
            robot: Some(name.to_owned()),
            ..Default::default()
        }));
    }
    configs
}

/// A simulator with its buffers.
struct Run {
    simulator: Box<dyn Simulator>,
    observation: Vec<f32>,
    terms: Vec<f64>,
}

impl Run {
    fn of(config: &dyn SimulatorConfig) -> Self {
        let simulator = config.build().unwrap();
        let spec = simulator.spec();
        let (observation, terms) = (vec![0.0; spec.observation_size], vec![0.0; spec.reward_terms.len()]);
        Self { simulator, observation, terms }
    }

    fn reset(&mut self, start: Start) {
        self.simulator.reset(&Task::default(), &start, &mut self.observation).unwrap();
    }

    fn step(&mut self, action: &[f32]) -> End {
        self.simulator.step(action, &mut self.observation, &mut self.terms).unwrap()
    }

    /// The random action of a step.
    fn action(&self, step: u64) -> Vec<f32> {
        let mut stream = Seed::root(5).index(step).stream();
        (0..self.simulator.spec().action_size()).map(|_| stream.random::<f32>() * 2.0 - 1.0).collect()
    }
}

#[test]
fn the_standard_pose_is_seen_as_roboschool_sees_it() {
    let heights = [("ant", 0.75), ("half-cheetah", 0.7), ("walker2d", 1.25)];
    for config in configs() {
        let mut run = Run::of(config.as_ref());
        run.reset(Start::Seed(3));
        let robot = run.simulator.spec().robot.clone();
        let state = run.simulator.state().unwrap();
        let height = heights.iter().find(|(name, _)| *name == robot).unwrap().1;
        assert!((state.memory[0] - height).abs() < 1e-9, "{robot}: z0 is {}", state.memory[0]);
        let (torso, joints) = run.observation.split_at(8);
        // Joint noise moves the mean place by some millimetres, seen from a target a kilometre away.
        let expected = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        assert!(
            torso.iter().zip(expected).all(|(a, b): (&f32, f32)| (a - b).abs() < 1e-4),
            "{robot}: {torso:?}"
        );
        let actuated = run.simulator.spec().action_size();
        assert!(joints[..2 * actuated].iter().skip(1).step_by(2).all(|&speed| speed == 0.0), "{robot}");
        assert!(joints[2 * actuated..].iter().all(|&contact| contact == 0.0), "{robot}");
        // The first joint lies where its coordinate says: hip_1's range is symmetric, bthigh's and thigh's are not.
        let q = state.positions[state.positions.len() - actuated];
        let (low, high) = match robot.as_str() {
            "ant" => (-40_f64.to_radians(), 40_f64.to_radians()),
            "half-cheetah" => (-0.52, 1.05),
            _ => (-150_f64.to_radians(), 0.0),
        };
        let expected = (2.0 * q - low - high) / (high - low);
        assert!((f64::from(joints[0]) - expected).abs() < 1e-6, "{robot}: {} {expected}", joints[0]);
        let limits: f64 = if robot == "ant" { 4.0 } else { 1.0 };
        run.step(&vec![0.0; actuated]);
        assert!(run.terms[4] >= limits, "{robot}: {:?}: ankles and ffoot start outside", run.terms);
    }
}

#[test]
fn a_state_carries_on_where_it_was_taken() {
    for config in configs() {
        let (mut run, mut other) = (Run::of(config.as_ref()), Run::of(config.as_ref()));
        let robot = run.simulator.spec().robot.clone();
        run.reset(Start::Seed(1));
        for step in 0..40 {
            let state = run.simulator.state().unwrap();
            other.reset(Start::State(state.clone()));
            assert_eq!(other.simulator.state().unwrap().memory, state.memory, "{robot}, step {step}");
            for (a, b) in run.observation.iter().zip(&other.observation) {
                assert!((a - b).abs() < 1e-6, "{robot}, step {step}: {a} {b}");
            }
            let action = run.action(step);
            let ends = (run.step(&action), other.step(&action));
            assert_eq!(ends.0, ends.1, "{robot}, step {step}");
            for (a, b) in run.terms.iter().zip(&other.terms) {
                assert!((a - b).abs() < 1e-3, "{robot}, step {step}: {:?} {:?}", run.terms, other.terms);
            }
            if ends.0 != End::Running {
                break;
            }
        }
    }
}

#[test]
fn threads_and_reuse_change_no_bit() {
    for config in configs() {
        let episode = |run: &mut Run| {
            run.reset(Start::Seed(9));
            let steps = (0..60).take_while(|&step| run.step(&run.action(step)) == End::Running).count();
            (steps, run.observation.clone(), run.simulator.state().unwrap())
        };
        let mut first = Run::of(config.as_ref());
        let expected = episode(&mut first);
        assert_eq!(episode(&mut first), expected);
        let slippery = Task::new([("floor_friction", 0.05), ("payload", 1.0)]);
        first.simulator.reset(&slippery, &Start::Seed(2), &mut first.observation).unwrap();
        first.step(&first.action(0));
        assert_eq!(episode(&mut first), expected, "after another task");
        std::thread::scope(|scope| {
            let others: Vec<_> =
                (0..4).map(|_| scope.spawn(|| episode(&mut Run::of(config.as_ref())))).collect();
            for other in others {
                assert_eq!(other.join().unwrap(), expected);
            }
        });
    }
}

#[test]
fn a_step_allocates_nothing() {
    // Rapier allocates in its own step.
    for config in configs().into_iter().filter(|config| config.engine().name != "rapier") {
        let mut run = Run::of(config.as_ref());
        run.reset(Start::Seed(0));
        let actions: Vec<Vec<f32>> = (0..12).map(|step| run.action(step)).collect();
        let (before, mut steps) = (ALLOCATIONS.get(), 0);
        while steps < actions.len() && run.step(&actions[steps]) == End::Running {
            steps += 1;
        }
        assert_eq!(ALLOCATIONS.get(), before, "{} in {steps} steps", run.simulator.spec().robot);
        assert!(steps > 5);
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
