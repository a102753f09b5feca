//! Films of the options, to be watched in three dimensions.

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use elo_core::replay::{FilmOf, Replay};
use maud::{Markup, PreEscaped, html};
use serde_json::json;

use super::sheet::{Section, Sheet};

/// The section.
pub fn section(sheet: &mut Sheet<'_>) -> Section {
    let replays = &sheet.run.replays;
    let body = if replays.iter().any(|replay| !replay.films.is_empty()) {
        player(replays)
    } else {
        html! {
            p.absent {
                "There are no films: the simulator has no bodies to be seen, its engine was missing, another version of the "
                "program made the run, or " code { "--replays 0" } " asked for none; " code { "elo report" } " says which."
            }
        }
    };
    Section { id: "replay", title: "Replay", body }
}

fn player(replays: &[Replay]) -> Markup {
    let engines: Vec<serde_json::Value> = replays.iter().map(packed).collect();
    // No `<` may stand in a script: it could end it.
    let data = serde_json::Value::from(engines).to_string().replace('<', "\\u003c");
    html! {
        div.replay {
            script.films type="application/json" { (PreEscaped(data)) }
            noscript { p.absent { "The replay needs JavaScript." } }
            div.controls {
                label { "Who " select.who {} }
                label { "Context " select.context {} }
                label { "Speed " select.speed {
                    @for (speed, name) in [("0.1", "1/10"), ("0.25", "1/4"), ("0.5", "1/2"), ("1", "real time"), ("2", "2×")] {
                        option value=(speed) selected[speed == "1"] { (name) }
                    }
                } }
                label { input.follow type="checkbox" checked; " Camera follows" }
            }
            div.stage tabindex="0" role="group" aria-label="Replay. Space plays and pauses, left and right arrows step, Home and End jump." {
                canvas {}
                div.captions {}
            }
            div.controls {
                button.toggle type="button" { "Play" }
                label.scrub { span.unseen { "Time" } input.time type="range" min="0" max="1" step="1" value="0"; }
                output.clock { "0.00 s" }
                div.camera role="group" aria-label="Camera" {
                    button type="button" data-turn="-1" aria-label="Turn left" { "⟲" }
                    button type="button" data-turn="1" aria-label="Turn right" { "⟳" }
                    button type="button" data-zoom="0.8" aria-label="Nearer" { "+" }
                    button type="button" data-zoom="1.25" aria-label="Farther" { "−" }
                    button type="button" data-reset="" { "Reset view" }
                }
            }
            p.note {
                "Drag to turn, scroll to zoom. Space plays and pauses, arrow keys step, with Shift by ten. Lines on the floor "
                "are 0.5 m apart, the strong ones 5 m. A film stops where the robot falls."
            }
            p.error role="alert" hidden {}
        }
    }
}

fn packed(replay: &Replay) -> serde_json::Value {
    json!({
        "engine": replay.engine,
        "control_step": replay.control_step,
        "scene": replay.scene,
        "films": replay.films.iter().map(film).collect::<Vec<_>>(),
    })
}

/// A film in 14 bytes a body and step: places as shares of their range, quaternions in parts of 32767.
fn film(film: &FilmOf) -> serde_json::Value {
    let steps = &film.film.steps;
    let places = || steps.iter().flatten().map(|pose| pose.position);
    let low = places().fold([f64::INFINITY; 3], |low, p| [0, 1, 2].map(|axis| low[axis].min(p[axis])));
    let high = places().fold([f64::NEG_INFINITY; 3], |high, p| [0, 1, 2].map(|axis| high[axis].max(p[axis])));
    let span = [0, 1, 2].map(|axis| (high[axis] - low[axis]).max(1e-9));
    let mut bytes = Vec::new();
    for pose in steps.iter().flatten() {
        for axis in 0..3 {
            let share = (pose.position[axis] - low[axis]) / span[axis];
            bytes.extend(((share * 65535.0).round() as u16).to_le_bytes());
        }
        for part in pose.rotation {
            bytes.extend(((part * 32767.0).round() as i16).to_le_bytes());
        }
    }
    json!({
        "who": film.who,
        "context": film.context,
        "returns": film.film.returns,
        "steps": steps.len(),
        "low": low,
        "span": span,
        "poses": BASE64_STANDARD.encode(bytes),
    })
}
