//! A point mass that breaks any one rule of the suite, and the demand that the right check finds it.

use std::sync::atomic::{AtomicU32, Ordering};
use std::thread::ThreadId;

use serde::{Deserialize, Serialize};

use super::{CHECKS, Case};
use crate::conformance::liars::{Lie, allocations, demand_that_liars_are_caught};
use crate::conformance::point_mass::PointMassConfig;
use crate::fault::Faults;
use crate::scene::{Pose, Scene, Visible};
use crate::simulator::{
    BuildError, End, Engine, Simulator, SimulatorConfig, SimulatorError, Start, State, check_action,
    check_length,
};
use crate::spec::{SimulatorSpec, Weight};
use crate::task::Task;

/// A point mass that breaks the rule called `lie`.
#[derive(Debug, Serialize, Deserialize)]
struct LiarConfig {
    lie: String,
    #[serde(skip)]
    forgotten: f32,
}

#[typetag::serde(name = "liar")]
impl SimulatorConfig for LiarConfig {
    fn validate(&self, faults: &mut Faults) {
        faults.check(self.lie != "config_is_valid", "lie", || "expected the truth".to_owned());
    }

    fn spec(&self) -> Result<SimulatorSpec, BuildError> {
        let mut spec = PointMassConfig::default().description();
        match self.lie.as_str() {
            "spec_survives_files" => spec.reward_floor = f64::NEG_INFINITY,
            "names_identify" => spec.reward_terms[1].name = spec.reward_terms[0].name.clone(),
            "sizes_are_positive" => spec.action_high.push(1.0),
            "action_bounds_are_ordered" => std::mem::swap(&mut spec.action_low, &mut spec.action_high),
            "control_step_is_positive" => spec.control_step = 0.0,
            "weights_are_defined" => spec.reward_terms[1].weight = Weight::Parameter("cost".to_owned()),
            "defaults_lie_in_their_ranges" => spec.task_parameters[1].default = 0.05,
            "capabilities_are_honest" => spec.capabilities.settable_state = false,
            "rewards_stay_above_the_floor" => spec.reward_floor = 0.5,
            _ => {}
        }
        Ok(spec)
    }

    fn engine(&self) -> Engine {
        PointMassConfig::default().engine()
    }

    fn build(&self) -> Result<Box<dyn Simulator>, BuildError> {
        static BUILT: AtomicU32 = AtomicU32::new(0);
        let mut spec = self.spec()?;
        if self.lie == "spec_agrees_with_the_object" {
            spec.robot = "another".to_owned();
        }
        Ok(Box::new(Liar {
            lie: self.lie.clone(),
            forgotten: self.forgotten,
            spec,
            inner: PointMassConfig::default().build()?,
            serial: BUILT.fetch_add(1, Ordering::Relaxed),
            home: std::thread::current().id(),
            reads: AtomicU32::new(0),
            memory: Memory::default(),
        }))
    }
}

struct Liar {
    lie: String,
    forgotten: f32,
    spec: SimulatorSpec,
    inner: Box<dyn Simulator>,
    serial: u32,
    home: ThreadId,
    reads: AtomicU32,
    memory: Memory,
}

/// What a liar remembers though it should not.
#[derive(Default)]
struct Memory {
    task: Task,
    mass: Option<f64>,
    seed: Option<u64>,
    repeated: bool,
    erred: bool,
    was_reset: bool,
    from_state: bool,
    ended: bool,
    wind: f64,
    elapsed: u64,
    first_poses: Vec<Pose>,
}

impl Liar {
    fn is(&self, lie: &str) -> bool {
        self.lie == lie
    }

    /// What is wrong with every observation.
    fn offset(&self) -> f32 {
        let wrong = match self.lie.as_str() {
            "fresh_objects_repeat" => self.serial as f32,
            "a_used_object_repeats" => f32::from(self.memory.repeated),
            "an_error_leaves_nothing" => f32::from(self.memory.erred),
            "another_thread_repeats" => f32::from(self.home != std::thread::current().id()),
            "config_survives_files" => self.forgotten,
            _ => 0.0,
        };
        wrong * 1e-3
    }

    /// The task that it takes `task` for.
    fn misread(&mut self, task: &Task) -> Task {
        let declared = |name: &str| self.spec.task_parameter(name);
        let all = task.parameters();
        let possible = |mass: &f64| (0.1..=10.0).contains(mass);
        let mass = task.get("mass").filter(possible);
        match self.lie.as_str() {
            "unknown_task_parameters_are_refused" => {
                Task::new(all.filter(|(name, _)| declared(name).is_some()))
            }
            "task_values_outside_their_ranges_are_refused" => {
                Task::new(all.map(|(name, value)| {
                    (name, declared(name).map_or(value, |p| value.max(p.low).min(p.high)))
                }))
            }
            "the_order_of_episodes_is_immaterial" => {
                self.memory.mass = mass.or(self.memory.mass);
                Task::new(all.chain(self.memory.mass.map(|mass| ("mass", mass))))
            }
            "dynamics_parameters_change_something" => {
                Task::new(all.filter(|(_, value)| mass != Some(*value)))
            }
            "defaults_are_those_of_the_spec" => Task::new([("mass", 2.0)].into_iter().chain(all)),
            _ => task.clone(),
        }
    }

    /// The start that it takes `start` for.
    fn mistake(&self, start: &Start) -> Result<Start, SimulatorError> {
        let refuse = |why: &str| Err(SimulatorError::Start(why.to_owned()));
        Ok(match (self.lie.as_str(), start.clone()) {
            ("seeds_choose_the_start", Start::Seed(_)) => Start::Seed(0),
            ("every_seed_is_accepted", Start::Seed(seed)) if i64::try_from(seed).is_err() => {
                return refuse("too great a seed");
            }
            ("malformed_states_are_refused", Start::State(mut state)) => {
                state.positions.truncate(1);
                Start::State(state)
            }
            ("restore_resumes", Start::State(state)) => Start::State(State {
                velocities: state.velocities.iter().map(|v| v * 0.0).collect(),
                ..state
            }),
            ("states_come_back_as_they_were", Start::State(state)) => {
                Start::State(State { elapsed: 0, ..state })
            }
            ("fallen_states_can_be_taken_up", Start::State(state))
                if state.positions.iter().any(|x| x.abs() >= 2.0) =>
            {
                return refuse("it has fallen");
            }
            (_, start) => start,
        })
    }

    /// The action that it takes `action` for, if it is another.
    fn misdo(&self, action: &[f32]) -> Option<Vec<f32>> {
        let finite = check_action(action).is_ok();
        let each = |change: fn(&f32) -> f32| Some(action.iter().map(change).collect());
        match self.lie.as_str() {
            "wrong_lengths_are_refused" if action.len() > 1 => Some(vec![action[0]]),
            "nonfinite_actions_are_refused" if !finite => each(|a| if a.is_finite() { *a } else { 0.0 }),
            "reading_the_state_disturbs_nothing" if self.reads.load(Ordering::Relaxed) > 0 => {
                each(|a| a * 0.5)
            }
            "every_action_component_matters" if finite => each(|a| a * 0.0),
            _ => None,
        }
    }
}

impl Simulator for Liar {
    fn spec(&self) -> &SimulatorSpec {
        &self.spec
    }

    fn reset(&mut self, task: &Task, start: &Start, observation: &mut [f32]) -> Result<(), SimulatorError> {
        let (read, start) = (self.misread(task), self.mistake(start)?);
        let result = self.inner.reset(&read, &start, observation);
        self.memory.erred |= result.is_err();
        result?;
        let seed = if let Start::Seed(seed) = start { Some(seed) } else { None };
        self.memory = Memory {
            task: task.clone(),
            repeated: seed.is_some() && self.memory.seed == seed,
            seed,
            was_reset: true,
            from_state: seed.is_none(),
            ended: false,
            wind: if seed.is_some() { 0.5 } else { self.memory.wind },
            elapsed: if let Start::State(state) = &start { state.elapsed } else { 0 },
            first_poses: self.inner.visible().map_or(Ok(Vec::new()), Visible::poses)?,
            ..std::mem::take(&mut self.memory)
        };
        self.reads = AtomicU32::new(0);
        observation[0] += self.offset();
        Ok(())
    }

    fn step(
        &mut self,
        action: &[f32],
        observation: &mut [f32],
        reward_terms: &mut [f64],
    ) -> Result<End, SimulatorError> {
        let restarts = (self.is("steps_need_a_reset") && !self.memory.was_reset)
            || (self.is("steps_after_an_end_are_refused") && self.memory.ended);
        if restarts {
            self.reset(&Task::default(), &Start::Seed(0), &mut [0.0; 2])?;
        }
        if self.is("an_error_ends_the_episode") {
            check_length("action", action.len(), 1)?;
            check_length("observation", observation.len(), 2)?;
            check_length("reward terms", reward_terms.len(), 2)?;
            check_action(action)?;
        }
        if self.is("steps_allocate_nothing") {
            std::hint::black_box(vec![0_u8; 8]);
        }
        let before = reward_terms.last().copied();
        let taken = self.misdo(action);
        let done = self.inner.step(taken.as_deref().unwrap_or(action), observation, reward_terms);
        self.memory.erred |= done.is_err();
        let mut end = done?;
        self.memory.elapsed += 1;
        observation[0] += self.offset();
        match self.lie.as_str() {
            "numbers_are_finite" if observation[0].abs() > 1.5 => reward_terms[0] = f64::NAN,
            "buffers_are_filled" => reward_terms[1] += before.unwrap_or(0.0),
            "states_move_between_objects" => reward_terms[0] += self.memory.wind,
            "reward_parameters_do_not_move_anything" => {
                reward_terms[1] *= self.spec.parameter_value(&self.memory.task, "effort_cost");
            }
            "actions_are_clamped" => observation[1] += action[0] - action[0].clamp(-1.0, 1.0),
            "ends_come_again" if end == End::Terminated && self.memory.from_state => end = End::Truncated,
            "time_alone_is_no_fall" if self.memory.elapsed > 1000 => end = End::Terminated,
            _ => {}
        }
        self.memory.ended = end != End::Running;
        Ok(end)
    }

    fn state(&self) -> Result<State, SimulatorError> {
        self.reads.fetch_add(1, Ordering::Relaxed);
        let state = self.inner.state();
        if self.is("states_need_a_reset") { Ok(state.unwrap_or_default()) } else { state }
    }

    fn visible(&self) -> Option<&dyn Visible> {
        Some(self)
    }
}

impl Visible for Liar {
    fn scene(&self) -> Scene {
        self.inner.visible().expect("a point mass can be seen").scene()
    }

    fn poses(&self) -> Result<Vec<Pose>, SimulatorError> {
        let poses = self.inner.visible().expect("a point mass can be seen").poses()?;
        // Every other step it is still where it was reset.
        let late = self.is("scene_follows_the_state") && self.memory.elapsed % 2 == 1;
        Ok(if late { self.memory.first_poses.clone() } else { poses })
    }
}

/// The liars, one for each check, with the checks that cannot help finding them too.
const LIES: &[(&str, &[&str])] = &[
    ("config_is_valid", &[]),
    ("config_survives_files", &[]),
    ("spec_agrees_with_the_object", &[]),
    ("spec_survives_files", &[]),
    ("names_identify", &[]),
    (
        "sizes_are_positive",
        &[
            "numbers_are_finite",
            "rewards_stay_above_the_floor",
            "steps_after_an_end_are_refused",
            "ends_come_again",
            "fallen_states_can_be_taken_up",
        ],
    ),
    ("action_bounds_are_ordered", &["actions_are_clamped"]),
    ("control_step_is_positive", &[]),
    ("weights_are_defined", &[]),
    ("defaults_lie_in_their_ranges", &["defaults_are_those_of_the_spec"]),
    ("capabilities_are_honest", &[]),
    (
        "fresh_objects_repeat",
        &[
            "config_survives_files",
            "the_order_of_episodes_is_immaterial",
            "an_error_leaves_nothing",
            "another_thread_repeats",
            "states_move_between_objects",
            "fallen_states_can_be_taken_up",
            "reward_parameters_do_not_move_anything",
        ],
    ),
    (
        "a_used_object_repeats",
        &[
            "the_order_of_episodes_is_immaterial",
            "an_error_leaves_nothing",
            "another_thread_repeats",
            "buffers_are_filled",
            "reading_the_state_disturbs_nothing",
            "defaults_are_those_of_the_spec",
            "actions_are_clamped",
        ],
    ),
    ("the_order_of_episodes_is_immaterial", &[]),
    ("an_error_leaves_nothing", &[]),
    ("another_thread_repeats", &[]),
    ("seeds_choose_the_start", &[]),
    ("every_seed_is_accepted", &[]),
    ("numbers_are_finite", &["fallen_states_can_be_taken_up"]),
    ("buffers_are_filled", &[]),
    ("rewards_stay_above_the_floor", &[]),
    ("steps_allocate_nothing", &[]),
    ("wrong_lengths_are_refused", &[]),
    ("nonfinite_actions_are_refused", &[]),
    ("steps_need_a_reset", &[]),
    ("steps_after_an_end_are_refused", &[]),
    ("an_error_ends_the_episode", &[]),
    ("unknown_task_parameters_are_refused", &[]),
    ("task_values_outside_their_ranges_are_refused", &[]),
    ("states_need_a_reset", &[]),
    ("malformed_states_are_refused", &[]),
    (
        "restore_resumes",
        &[
            "states_move_between_objects",
            "states_come_back_as_they_were",
            "ends_come_again",
            "fallen_states_can_be_taken_up",
        ],
    ),
    ("states_move_between_objects", &[]),
    ("states_come_back_as_they_were", &[]),
    (
        "reading_the_state_disturbs_nothing",
        &["restore_resumes", "states_move_between_objects", "ends_come_again"],
    ),
    ("ends_come_again", &[]),
    ("fallen_states_can_be_taken_up", &[]),
    ("time_alone_is_no_fall", &[]),
    ("reward_parameters_do_not_move_anything", &[]),
    ("dynamics_parameters_change_something", &[]),
    ("defaults_are_those_of_the_spec", &[]),
    ("actions_are_clamped", &[]),
    (
        "every_action_component_matters",
        &["steps_allocate_nothing", "dynamics_parameters_change_something", "scene_follows_the_state"],
    ),
    ("scene_follows_the_state", &[]),
];

#[test]
fn each_liar_is_caught_by_the_check_that_is_meant_for_it() {
    let lies: Vec<_> = LIES
        .iter()
        .map(|(caught_by, also)| {
            let config = LiarConfig { lie: (*caught_by).to_owned(), forgotten: 1.0 };
            let subject = Box::new(Case::new(Box::new(config)).counting(allocations));
            Lie { caught_by, also, subject }
        })
        .collect();
    demand_that_liars_are_caught(CHECKS, &lies);
}

#[test]
fn a_liar_without_a_lie_keeps_every_rule() {
    let config = LiarConfig { lie: "none".to_owned(), forgotten: 0.0 };
    let report = super::run(&Case::new(Box::new(config)).counting(allocations));
    assert!(report.failed().is_empty() && report.skipped().is_empty(), "{report}");
}
