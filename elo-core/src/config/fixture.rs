//! A config with one field of every shape, for the tests of this folder.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::fault::Faults;
use crate::metric::{MaximumMean, Metric, NegativeTail, Reference};
use crate::plugin::{PLUGINS, Plugin};
use crate::select::Selector;
use crate::simulator::SimulatorConfig;
use crate::task::{Range, TaskDistribution};

/// All plugins that the tests know.
pub const ALL: &[&[Plugin]] =
    &[PLUGINS, &[Plugin::metric::<Odd>("odd", "a metric with fields of every shape")]];

/// A toy experiment.
#[derive(Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Toy {
    /// The root of every random draw.
    pub seed: u64,
    /// Which robot.
    pub simulator: Box<dyn SimulatorConfig>,
    /// `P`.
    #[serde(default)]
    pub tasks: TaskDistribution,
    /// What selects.
    pub metrics: Vec<Box<dyn Metric>>,
    /// One more metric, or none.
    pub extra: Option<Box<dyn Metric>>,
    /// Sizes.
    #[serde(default)]
    pub discover: Sizes,
    /// How to choose, or by default.
    pub selector: Option<Box<dyn Selector>>,
}

impl Default for Toy {
    fn default() -> Self {
        Self {
            seed: 7,
            simulator: Box::new(crate::conformance::point_mass::PointMassConfig::default()),
            tasks: TaskDistribution::new([("cost", Range { low: -2.4, high: -1.4 })]),
            metrics: vec![
                Box::new(MaximumMean {}),
                Box::new(NegativeTail::default()),
                Box::new(Odd::default()),
            ],
            extra: None,
            discover: Sizes::default(),
            selector: None,
        }
    }
}

/// Some sizes, see [`Toy::discover`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Sizes {
    /// `N`.
    #[schemars(range(min = 1, max = 1000))]
    pub candidates: usize,
    /// `K`, at most all of them.
    pub set_size: u32,
    /// `γ`.
    #[schemars(range(min = 0.0, max = 1.0))]
    pub discount: f64,
    /// What to do at a fall.
    pub at_fall: AtFall,
}

impl Default for Sizes {
    fn default() -> Self {
        Self { candidates: 600, set_size: 5, discount: 1.0, at_fall: AtFall::Stop }
    }
}

/// What to do at a fall.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum AtFall {
    /// End.
    Stop,
    /// Do not.
    Continue,
}

/// Every shape of field.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Odd {
    /// A number that a `f64` prints with too many digits. This sentence is here to make the comment longer
    /// than one line may be.
    #[schemars(extend("exclusiveMinimum" = 0.0))]
    pub clip: f32,
    /// May be left out.
    #[schemars(range(max = 10))]
    pub limit: Option<u8>,
    /// Exactly two.
    pub pair: [f64; 2],
    /// Words.
    #[schemars(length(min = 1))]
    pub layers: Vec<String>,
    /// Any names.
    pub weights: BTreeMap<String, f64>,
    /// A table in a table.
    pub inner: Inner,
    /// A choice with fields.
    pub rule: Rule,
    /// A choice around fields.
    pub start: Start,
    /// A truth.
    pub quick: bool,
}

/// A table in a table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Inner {
    /// A text with all that needs escapes.
    pub name: String,
    /// A signed integer.
    pub offset: i32,
}

/// Told apart by a field.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "rule", rename_all = "snake_case", deny_unknown_fields)]
pub enum Rule {
    /// No fields.
    Never {},
    /// One field.
    After {
        /// Control steps.
        steps: u32,
    },
}

/// Told apart by a key.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Start {
    /// No fields.
    Standard,
    /// Numbered.
    Seed(u64),
}

impl Default for Odd {
    fn default() -> Self {
        Self {
            clip: 0.2,
            limit: None,
            pair: [0.9, 1e-8],
            layers: vec!["tanh".to_owned()],
            weights: BTreeMap::from([("a b".to_owned(), 1.0)]),
            inner: Inner::default(),
            rule: Rule::After { steps: 3 },
            start: Start::Seed(u64::MAX),
            quick: true,
        }
    }
}

impl Default for Inner {
    fn default() -> Self {
        Self { name: "π \"x\" \\ \n\u{7f}\u{202e}".to_owned(), offset: -3 }
    }
}

#[typetag::serde(name = "odd")]
impl Metric for Odd {
    fn label(&self) -> String {
        "odd".to_owned()
    }

    fn validate(&self, _: &mut Faults) {}

    fn rollout_score(&self, value: f64, _: &Reference) -> f64 {
        value
    }
}
