//! Every plugin of every `PLUGINS` slice under the suite of its trait, and the slices against what can be deserialised.

#![allow(clippy::unwrap_used)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::collections::BTreeSet;

use elo_backends::locomotion::robot;
use elo_core::conformance::check::Report;
use elo_core::conformance::simulator::Tolerance;
use elo_core::conformance::{metric, option_learner, point_mass::PointMassConfig, simulator, teacher};
use elo_core::discover::duplicate;
use elo_core::fault::Faults;
use elo_core::hosted::Hosted;
use elo_core::metric::Metric;
use elo_core::plugin::{Plugin, Role};
use elo_core::policy::{OptionLearner, TeacherConfig};
use elo_core::select::Selector;
use elo_core::simulator::SimulatorConfig;
use elo_tests::toy::formats;
use elo_tests::{PLUGINS, skipped};
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

fn of_role(role: Role) -> impl Iterator<Item = &'static Plugin> {
    PLUGINS.iter().flat_map(|slice| slice.iter()).filter(move |plugin| plugin.role == role)
}

/// The default config of a plugin with some fields set; those that it does not have are left out.
fn config<T: DeserializeOwned>(plugin: &Plugin, fields: &Value) -> T {
    let mut config = (plugin.default_config)();
    let known = config.as_object_mut().unwrap();
    for (name, value) in fields.as_object().unwrap() {
        if let Some(field) = known.get_mut(name) {
            *field = value.clone();
        }
    }
    serde_json::from_value(config).unwrap()
}

fn require(report: Report) -> Report {
    report.require_clean().unwrap_or_else(|report| panic!("{report}"))
}

/// The kinds that serde knows for a trait: it names them all when asked for one that there is not.
fn known_kinds<T: DeserializeOwned>() -> BTreeSet<String> {
    let error = serde_json::from_value::<T>(json!({ "kind": "?" })).err().unwrap().to_string();
    let (_, kinds) = error.split_once("expected").unwrap_or_else(|| panic!("{error}"));
    kinds.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

#[test]
fn what_is_listed_is_known_and_what_is_known_is_listed() {
    let known = [
        (Role::Simulator, known_kinds::<Box<dyn SimulatorConfig>>()),
        (Role::Teacher, known_kinds::<Box<dyn TeacherConfig>>()),
        (Role::OptionLearner, known_kinds::<Box<dyn OptionLearner>>()),
        (Role::Metric, known_kinds::<Box<dyn Metric>>()),
        (Role::Selector, known_kinds::<Box<dyn Selector>>()),
    ];
    for (role, known) in known {
        let listed: Vec<String> = of_role(role).map(|plugin| plugin.kind.to_owned()).collect();
        let distinct: BTreeSet<String> = listed.iter().cloned().collect();
        assert_eq!(listed.len(), distinct.len(), "a kind of {} is listed twice: {listed:?}", role.name());
        assert_eq!(distinct, known, "listed against known kinds of {}", role.name());
        for plugin in of_role(role) {
            assert_eq!((plugin.default_config)()["kind"], plugin.kind, "{plugin:?}");
            assert!(!plugin.summary.is_empty() && !plugin.summary.contains('\n'), "{plugin:?}");
        }
    }
    let formats: Vec<&str> = of_role(Role::PolicyFormat).map(|plugin| plugin.format.unwrap().name).collect();
    assert_eq!(formats.len(), formats.iter().collect::<BTreeSet<_>>().len(), "{formats:?}");
    assert!(of_role(Role::PolicyFormat).all(|plugin| plugin.kind == plugin.format.unwrap().name));
}

/// What an engine states about states that it takes up: see the suite's own default for the others.
fn tolerance(kind: &str) -> Tolerance {
    match kind {
        // Engines whose solver starts from its last solution.
        "mujoco" => Tolerance { start: 1e-6, step: 1e-3 },
        "rapier" => Tolerance { start: 1e-6, step: 1e-3 },
        _ => Tolerance::default(),
    }
}

#[test]
fn every_simulator_conforms_with_every_robot() {
    let test = "every_simulator_conforms_with_every_robot";
    let mut tried = 0;
    for plugin in of_role(Role::Simulator) {
        let has_robots = (plugin.default_config)().get("robot").is_some();
        let robots: &[&str] = if has_robots { &robot::NAMES } else { &[""] };
        for robot in robots {
            let config: Box<dyn SimulatorConfig> = config(plugin, &json!({ "robot": robot }));
            if config.hosted().is_some_and(Hosted::needs_description) {
                // What only a worker knows is tried where the worker is: `python/tests/test_simulators.py`.
                continue;
            }
            let linked = config.build().is_ok();
            let case = simulator::Case::new(config).within(tolerance(plugin.kind));
            // Rapier allocates in its own step.
            let case = if plugin.kind == "rapier" { case } else { case.counting(allocations) };
            let report = require(simulator::run(&case));
            if linked {
                tried += 1;
            } else {
                skipped(test, &format!("{} {robot}: {report}", plugin.kind));
            }
        }
    }
    assert!(tried >= 4 + if cfg!(feature = "mujoco") { 3 } else { 0 }, "{tried}");
}

/// Settings that train in a moment and write some checkpoints.
fn quick() -> Value {
    json!({
        "steps": 2000, "rollout_steps": 200, "environments": 2, "minibatch": 50, "epochs": 3, "hidden": [8],
        "max_episode_steps": 60, "checkpoint_every": 400, "snapshots": 4, "d0_pool": 10, "context_pool": 5,
    })
}

#[test]
fn every_teacher_conforms() {
    for plugin in of_role(Role::Teacher) {
        let subject: Box<dyn TeacherConfig> = config(plugin, &quick());
        if subject.hosted().is_some() {
            // What runs in a worker is tried there: `python/tests/test_teachers_and_metrics.py`.
            continue;
        }
        let world = PointMassConfig { reset_spread: 1.5, ..PointMassConfig::default() };
        let case = teacher::Case::new(subject, Box::new(world));
        let report = require(teacher::run(&case));
        assert!(report.skipped().is_empty(), "{report}");
    }
}

#[test]
fn every_option_learner_conforms_with_every_robot() {
    let mut worlds: Vec<Box<dyn SimulatorConfig>> = vec![Box::new(PointMassConfig::default())];
    let rapier = of_role(Role::Simulator).find(|plugin| plugin.kind == "rapier").unwrap();
    for robot in robot::NAMES {
        worlds.push(config(rapier, &json!({ "robot": robot })));
    }
    for plugin in of_role(Role::OptionLearner) {
        for world in &worlds {
            let case = option_learner::Case::new(config(plugin, &quick()), duplicate(world), formats());
            require(option_learner::run(&case));
        }
    }
}

#[test]
fn every_metric_conforms() {
    for plugin in of_role(Role::Metric) {
        let metric: Box<dyn Metric> = config(plugin, &json!({}));
        if metric.hosted().is_some() {
            continue;
        }
        let report = require(metric::run(metric.as_ref()));
        assert!(report.skipped().is_empty(), "{report}");
    }
}

#[test]
fn every_selector_finds_no_fault_in_its_defaults() {
    for plugin in of_role(Role::Selector) {
        let selector: Box<dyn Selector> = config(plugin, &json!({}));
        let mut faults = Faults::new();
        selector.validate(&mut faults);
        assert_eq!(faults.found(), [], "{}", plugin.kind);
        assert!(selector.rollouts(600, 300) >= 600, "each candidate is measured at least once");
    }
}

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

/// How many allocations this thread has made.
fn allocations() -> u64 {
    ALLOCATIONS.with(Cell::get)
}

/// Counts what each thread allocates.
struct Counting;

#[global_allocator]
static COUNTING: Counting = Counting;

// SAFETY: every call is handed to the system's allocator as it is; the counter is a number that needs no destructor.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.with(|count| count.set(count.get() + 1));
        // SAFETY: the caller's promises are those that the system's allocator asks for.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(memory, layout) }
    }
}
