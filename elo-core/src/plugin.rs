//! Plugins are listed where a reader can see them: each crate has one `PLUGINS` slice of these entries.
//!
//! The slice links the crate, prints `elo plugins`, feeds `elo example KIND`, tells the configuration reader which
//! fields a kind has, and drives the conformance run. Adding a plugin costs its file, its `mod` line and its entry.

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Serialize;

use crate::metric::{MaximumMean, Metric, NegativeTail, PositiveSkew};
use crate::policy::{OptionLearner, PolicyFormat, TeacherConfig};
use crate::select::{Selector, Uniform};
use crate::simulator::SimulatorConfig;

/// One thing that a config can choose by its `kind`, or one format of stored policies.
#[derive(Clone, Copy, Debug)]
pub struct Plugin {
    /// Which trait it implements.
    pub role: Role,
    /// The `kind` that configs write (for formats: their name).
    pub kind: &'static str,
    /// One line for `elo plugins`.
    pub summary: &'static str,
    /// The fields of its config table, without `kind`.
    pub schema: fn(&mut SchemaGenerator) -> Schema,
    /// The config with every default, with `kind`, as JSON.
    pub default_config: fn() -> serde_json::Value,
    /// For [`Role::PolicyFormat`] alone.
    pub format: Option<PolicyFormat>,
}

/// What a plugin is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// `[simulator]`
    Simulator,
    /// `[teacher]`
    Teacher,
    /// `[option_learner]`
    OptionLearner,
    /// `[[metrics]]`
    Metric,
    /// `[selector]`
    Selector,
    /// How option policies are stored.
    PolicyFormat,
}

impl Role {
    /// The word used in messages and in `elo plugins`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Simulator => "simulator",
            Self::Teacher => "teacher",
            Self::OptionLearner => "option learner",
            Self::Metric => "metric",
            Self::Selector => "selector",
            Self::PolicyFormat => "policy format",
        }
    }
}

/// Defines a constructor for each role: the config's trait object gives the default its `kind`.
macro_rules! constructors {
    ($($name:ident: $role:ident as dyn $config:path;)*) => {
        impl Plugin {
            $(
                /// An entry for this role. `kind` must be the name that the config's `#[typetag::serde]` gives.
                pub const fn $name<C: $config + JsonSchema + Default>(
                    kind: &'static str,
                    summary: &'static str,
                ) -> Self {
                    Self {
                        role: Role::$role,
                        kind,
                        summary,
                        schema: C::json_schema,
                        default_config: || as_json(&C::default() as &dyn $config),
                        format: None,
                    }
                }
            )*
        }
    };
}

constructors! {
    simulator: Simulator as dyn SimulatorConfig;
    teacher: Teacher as dyn TeacherConfig;
    option_learner: OptionLearner as dyn OptionLearner;
    metric: Metric as dyn Metric;
    selector: Selector as dyn Selector;
}

impl Plugin {
    /// An entry for a format of stored option policies.
    pub const fn policy_format(format: PolicyFormat) -> Self {
        Self {
            role: Role::PolicyFormat,
            kind: format.name,
            summary: format.summary,
            schema: |_| Schema::default(),
            default_config: || serde_json::Value::Null,
            format: Some(format),
        }
    }
}

fn as_json<T: Serialize + ?Sized>(config: &T) -> serde_json::Value {
    serde_json::to_value(config).expect("a config is plain data")
}

/// What this crate brings itself.
pub const PLUGINS: &[Plugin] = &[
    Plugin::simulator::<crate::conformance::point_mass::PointMassConfig>(
        "point_mass",
        "a mass on a line; a toy for first steps and tests",
    ),
    Plugin::metric::<MaximumMean>("maximum_mean", "ψ_μ: the expected return (Eq. 4.5)"),
    Plugin::metric::<NegativeTail>("negative_tail", "ψ_-: the mean, less a price on poor returns (Eq. 4.6)"),
    Plugin::metric::<PositiveSkew>(
        "positive_skew",
        "ψ_+: the mean, plus a premium on good returns (Eq. 4.7)",
    ),
    Plugin::selector::<Uniform>("uniform", "every candidate in every context, as Algorithm 1 is printed"),
];
