//! A simulator and a metric of one's own, in a package that only depends on `elo`.
//!
//! Each is a struct whose fields are its table in a config, one `impl`, and one line in [`PLUGINS`]. `main.rs` hands the
//! slice to the program; `cart-pole.toml` uses both:
//!
//! ```text
//! cargo run --release --package own-plugins -- discover examples/own-plugins/cart-pole.toml
//! ```

use elo_core::plugin::Plugin;

pub mod cart_pole;
pub mod worst_share;

/// What this package brings.
pub const PLUGINS: &[Plugin] = &[
    Plugin::simulator::<cart_pole::CartPoleConfig>(
        "cart_pole",
        "a pole hinged to a cart, kept upright by a force",
    ),
    Plugin::metric::<worst_share::WorstShare>("worst_share", "the mean of the worst returns (CVaR)"),
];
