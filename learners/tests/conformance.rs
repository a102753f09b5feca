//! Every entry of [`PLUGINS`] under the suite of its role.
#![allow(clippy::unwrap_used)]

use elo_core::conformance::point_mass::PointMassConfig;
use elo_core::conformance::{option_learner, teacher};
use elo_core::plugin::{Plugin, Role};
use elo_core::policy::{OptionLearner, TeacherConfig};
use elo_learners::PLUGINS;

/// Fields that make a kind quick enough to be trained a dozen times.
fn quick_fields(kind: &str) -> serde_json::Value {
    match kind {
        "ppo" => serde_json::json!({
            "steps": 2000, "rollout_steps": 200, "environments": 2, "minibatch": 50, "epochs": 3, "hidden": [8],
            "snapshots": 4, "d0_pool": 10, "max_episode_steps": 60, "checkpoint_every": 400,
        }),
        "interest" => serde_json::json!({
            "steps": 400, "rollout_steps": 100, "context_pool": 5, "epochs": 2, "hidden": [8], "checkpoint_every": 100,
        }),
        "behavior_cloning" => serde_json::json!({ "hidden": [8], "epochs": 5 }),
        "dagger" => serde_json::json!({ "rounds": 2, "rollouts": 1 }),
        _ => serde_json::json!({}),
    }
}

/// The plugin's config as a file would give it, with the quick fields.
fn quick(plugin: &Plugin) -> serde_json::Value {
    let mut config = (plugin.default_config)();
    let fields = config.as_object_mut().unwrap();
    fields.extend(quick_fields(plugin.kind).as_object().unwrap().clone());
    config
}

#[test]
fn every_teacher_conforms() {
    for plugin in PLUGINS.iter().filter(|plugin| plugin.role == Role::Teacher) {
        let config: Box<dyn TeacherConfig> = serde_json::from_value(quick(plugin)).unwrap();
        let case = teacher::Case::new(config, Box::new(PointMassConfig::default()));
        teacher::run(&case).require_clean().unwrap_or_else(|report| panic!("{report}"));
    }
}

#[test]
fn every_option_learner_conforms_with_all_that_it_learns() {
    for plugin in PLUGINS.iter().filter(|plugin| plugin.role == Role::OptionLearner) {
        let learner: Box<dyn OptionLearner> = serde_json::from_value(quick(plugin)).unwrap();
        conforms(learner);
    }
}

fn conforms(learner: Box<dyn OptionLearner>) {
    let formats = PLUGINS.iter().filter_map(|plugin| plugin.format).collect();
    let case = option_learner::Case::new(learner, Box::new(PointMassConfig::default()), formats);
    option_learner::run(&case).require_clean().unwrap_or_else(|report| panic!("{report}"));
}

#[test]
fn sets_that_begin_from_recordings_conform_too() {
    let plugin = PLUGINS.iter().find(|plugin| plugin.kind == "interest").unwrap();
    let mut config = quick(plugin);
    config["imitation_start"] = true.into();
    conforms(serde_json::from_value(config).unwrap());
}

#[test]
fn every_default_config_is_valid() {
    for plugin in PLUGINS {
        let mut faults = elo_core::fault::Faults::new();
        let config = (plugin.default_config)();
        match plugin.role {
            Role::Teacher => {
                serde_json::from_value::<Box<dyn TeacherConfig>>(config).unwrap().validate(&mut faults);
            }
            Role::OptionLearner => {
                serde_json::from_value::<Box<dyn OptionLearner>>(config).unwrap().validate(&mut faults);
            }
            _ => {}
        }
        assert_eq!(faults.found(), [], "{}", plugin.kind);
    }
}
