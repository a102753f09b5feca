//! What actions do at, between and beyond their bounds.

use super::trace::{Episode, middle};
use super::{Case, Check, Finding, Violation};

pub(super) const ACTIONS_ARE_CLAMPED: Check<Case> = Check {
    name: "actions_are_clamped",
    rule: "An action outside the bounds moves the robot, bit for bit, as the nearest one inside does.",
    run: |case| {
        let mut simulator = case.simulator()?;
        let spec = simulator.spec().clone();
        let inside = Episode::random(&spec, 1, case.steps);
        let stretched = |action: &Vec<f32>| {
            let middle = middle(&spec);
            action.iter().zip(middle).map(|(a, m)| m + 3.0 * (a - m)).collect::<Vec<f32>>()
        };
        let clamped = |action: &Vec<f32>| {
            let bounds = spec.action_low.iter().zip(&spec.action_high);
            action.iter().zip(bounds).map(|(a, (low, high))| a.max(*low).min(*high)).collect::<Vec<f32>>()
        };
        let beyond = Episode { actions: inside.actions.iter().map(stretched).collect(), ..inside.clone() };
        let at_bounds = Episode { actions: beyond.actions.iter().map(clamped).collect(), ..inside };
        let expected = at_bounds.play(simulator.as_mut())?;
        Ok(expected.same_motion(&beyond.play(simulator.as_mut())?)?)
    },
};

pub(super) const EVERY_ACTION_COMPONENT_MATTERS: Check<Case> = Check {
    name: "every_action_component_matters",
    rule: "Holding any one action component at its lower or at its upper bound leads to different observations.",
    run: |case| {
        let mut simulator = case.simulator()?;
        let spec = simulator.spec().clone();
        for component in 0..spec.action_size() {
            let mut hold = |bound: f32| {
                let mut action = middle(&spec);
                action[component] = bound;
                let episode = Episode { actions: vec![action; case.steps], ..Episode::random(&spec, 1, 0) };
                Ok::<_, Finding>(episode.play(simulator.as_mut())?)
            };
            let (low, high) = (hold(spec.action_low[component])?, hold(spec.action_high[component])?);
            if low.same_motion(&high).is_ok() {
                let what = format!("observations with action[{component}] at either bound");
                return Err(Violation::new(what, "some difference", "none").into());
            }
        }
        Ok(())
    },
};
