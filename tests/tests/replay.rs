//! Films of a run's rollouts: they show what was measured.

#![allow(clippy::unwrap_used)]

use std::sync::atomic::AtomicBool;

use elo_core::crew::{Crew, Staff, Unwatched};
use elo_core::discover::{ContextSet, Run, discover, value};
use elo_core::experiment::Experiment;
use elo_core::performer::{Performer, PerformerRole};
use elo_core::replay::{Replay, replay};
use elo_core::report::report;
use elo_core::rollout::Rollout;
use elo_core::run_dir::RunDir;
use elo_core::units::evaluate::Behavior;
use elo_tests::toy::{NoWorkers, TOY, experiment, formats, toy_with};
use own_plugins::cart_pole::CartPoleConfig;

/// The returns that the report found for somebody, context by context.
fn returns(rollouts: &[Rollout], contexts: &ContextSet, floor: f64) -> Vec<f64> {
    let paid = |(rollout, prices): (&Rollout, &Vec<f64>)| value(rollout, prices).unwrap_or(floor);
    rollouts.iter().zip(&contexts.prices).map(paid).collect()
}

fn filmed(replay: &Replay, who: &str) -> Vec<f64> {
    replay.films.iter().filter(|film| film.who == who).map(|film| film.film.returns).collect()
}

/// Films of the best option and of random torque in the contexts of the report, with what the report found.
fn films(experiment: &Experiment, count: usize) -> (Option<Replay>, [Vec<f64>; 2]) {
    let folder = tempfile::tempdir().unwrap();
    let run_dir = RunDir::open(folder.path()).unwrap();
    let (stop, staff) =
        (AtomicBool::new(false), Staff { workers: 2, formats: formats(), program: "test".to_owned() });
    let crew = Crew::new(staff, &run_dir, &NoWorkers, &Unwatched, &stop);
    let discovery = discover(experiment, &crew).unwrap();
    let run = Run::new(experiment, &crew).unwrap();
    let held_out = report(&run, &discovery).unwrap();
    let best = discovery.selection.choices[0].chosen[0];
    let random = PerformerRole::Plain(|| Behavior::RandomTorque);
    let performers = [
        Performer::candidate(&discovery.candidates[best]),
        Performer { name: "random torque".to_owned(), role: random },
    ];
    let replay = replay(&run, &performers, &held_out.contexts, count).unwrap();
    let (name, baseline) = &held_out.baselines[0];
    assert_eq!(name, "random torque");
    let expected = [&held_out.options[&best], &baseline[0]]
        .map(|rollouts| returns(rollouts, &held_out.contexts, run.return_floor()));
    (replay, expected)
}

#[test]
fn a_film_shows_the_rollout_that_the_report_measured() {
    // Contexts in two blocks.
    let (replay, [option, random]) = films(&experiment(TOY), 55);
    let replay = replay.unwrap();
    assert_eq!((replay.control_step, replay.engine.name.as_str()), (0.05, "point_mass"));
    assert_eq!(replay.films.len(), 110);
    let who = replay.films[0].who.clone();
    assert_eq!(filmed(&replay, &who), option[..55]);
    assert_eq!(filmed(&replay, "random torque"), random[..55]);
    assert_ne!(option, random);
    assert_eq!(replay.films.iter().map(|film| film.context).collect::<Vec<_>>()[..55], Vec::from_iter(0..55));
    assert!(replay.films.iter().all(|film| film.film.steps.len() == 21), "20 steps and the start");
    let written = serde_json::to_string(&replay).unwrap();
    assert_eq!(serde_json::from_str::<Replay>(&written).unwrap(), replay);
}

#[test]
fn a_film_of_the_half_cheetah_shows_its_rollout_too() {
    let robot = [
        ("kind = \"point_mass\"\nreset_spread = 0.5", "kind = \"rapier\"\nrobot = \"half-cheetah\""),
        (
            "[tasks.effort_cost]\nlow = -0.3\nhigh = -0.05",
            "[tasks.electricity_cost]\nlow = -3.0\nhigh = -1.0",
        ),
        ("steps = 16_384", "steps = 2048"),
        ("candidates = 24\ncontexts = 60", "candidates = 6\ncontexts = 6"),
        ("[report]\ncontexts = 60", "[report]\ncontexts = 6"),
    ];
    let (replay, [option, random]) = films(&experiment(&toy_with(&robot)), 4);
    let replay = replay.unwrap();
    assert_eq!((replay.scene.bodies.len(), replay.scene.solids.len()), (7, 8));
    assert_eq!(filmed(&replay, "random torque"), random[..4]);
    assert_eq!(filmed(&replay, &replay.films[0].who), option[..4]);
}

#[test]
fn what_cannot_be_seen_has_no_replay() {
    let brief = toy_with(&[("steps = 16_384", "steps = 2048"), ("steps = 20\n", "steps = 5\n")]);
    let blind = Experiment { simulator: Box::new(CartPoleConfig::default()), ..experiment(&brief) };
    assert_eq!(films(&blind, 3).0, None);
}
