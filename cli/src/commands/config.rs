//! `elo config`: check, show, schema.

use elo_core::config;
use elo_core::experiment::Experiment;
use elo_core::plugin::Plugin;

use crate::arguments::{ConfigAction, ConfigFile};
use crate::exit::Exit;
use crate::load;
use crate::output::{print, print_json};

/// Does what `action` says.
pub fn run(action: &ConfigAction, plugins: &[&[Plugin]]) -> Result<(), Exit> {
    let load = |file: &ConfigFile| load::experiment(&file.config, &file.overrides, plugins);
    match action {
        ConfigAction::Check(file) => {
            load(file)?;
            print(&format!("{}: no faults\n", file.config.display()))
        }
        ConfigAction::Show(file) => {
            let text = config::show(&load(file)?).map_err(|error| Exit::Failed(error.to_string()))?;
            print(&text)
        }
        ConfigAction::Schema => {
            let schema = config::json_schema::<Experiment>(plugins);
            print_json(&schema)
        }
    }
}
