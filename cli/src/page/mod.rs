//! A page about finished runs that opens anywhere: one HTML file with all styles, scripts and data in it.
//!
//! | file | what |
//! | --- | --- |
//! | `data` | what a page is made of |
//! | `sheet` | one run on its way to the page |
//! | `chart`, `cells` | plots and figures, as all sections draw and write them |
//! | `summary`, `distributions`, `tables`, `tails`, `curves` (with `practice`), `gallery`, `scores`, `engines`, `replay`, `appendix` | a section each |
//! | `compare` | several runs side by side |
//! | `style.css`, `page.js`, `replay.js` | how it looks and moves |

mod appendix;
mod cells;
mod chart;
mod compare;
mod curves;
mod data;
mod distributions;
mod engines;
#[cfg(test)]
mod fixture;
mod gallery;
mod practice;
mod replay;
mod scores;
mod sheet;
mod summary;
mod tables;
mod tails;
#[cfg(test)]
mod tests;

use localgpt_world_export::html::{ORBIT_CONTROLS_JS, THREE_MODULE_JS, THREE_VERSION};
use maud::{DOCTYPE, Markup, PreEscaped, html};

pub use chart::Figure;
pub use data::{CandidateRow, PageData, RunData};

use chart::COLOURS;
use sheet::{Section, Sheet};

/// Nothing may be fetched from anywhere; what the page holds may run and be shown.
const POLICY: &str = "default-src 'none'; script-src 'unsafe-inline' blob:; style-src 'unsafe-inline'; \
                      img-src data: blob:; base-uri 'none'; form-action 'none'";

/// A page, and its plots for those who want them as files.
pub struct Page {
    /// The whole file.
    pub html: String,
    /// Every plot of it.
    pub figures: Vec<Figure>,
}

/// Writes the page.
pub fn render(data: &PageData) -> Page {
    let several = data.runs.len() > 1;
    let mut figures = Vec::new();
    let mut articles = Vec::new();
    for (index, run) in data.runs.iter().enumerate() {
        let mut sheet = Sheet::new(run, index, several);
        let sections = sections(&mut sheet);
        articles.push(article(&sheet, &sections, several));
        figures.append(&mut sheet.figures);
    }
    let replays = data.runs.iter().any(|run| !run.replays.is_empty());
    let title = match data.runs.as_slice() {
        [run] => format!("{} in {}: {}", run.report.robot, run.report.engine.name, run.name),
        runs => format!("{} runs", runs.len()),
    };
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta http-equiv="Content-Security-Policy" content=(POLICY);
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                meta name="generator" content={ "elo " (env!("CARGO_PKG_VERSION")) };
                link rel="icon" href="data:,";
                title { "elo: " (title) }
                style { (PreEscaped(colours())) (PreEscaped(include_str!("style.css"))) }
            }
            body {
                a.skip href="#main" { "Skip to the results" }
                header.top {
                    h1 { "Early-life options" }
                    p { (title) }
                }
                main #main {
                    @if several { (compare::section(&data.runs)) }
                    @for article in &articles { (article) }
                }
                footer { (footer(replays)) }
                @if replays { (three()) }
                script { (PreEscaped(include_str!("page.js"))) }
                @if replays { script type="module" { (PreEscaped(include_str!("replay.js"))) } }
            }
        }
    };
    Page { html: page.into_string() + "\n", figures }
}

fn sections(sheet: &mut Sheet<'_>) -> Vec<Section> {
    vec![
        summary::section(sheet),
        distributions::section(sheet),
        tables::section(sheet),
        curves::section(sheet),
        gallery::section(sheet),
        scores::section(sheet),
        engines::section(sheet),
        replay::section(sheet),
        appendix::section(sheet),
    ]
}

fn article(sheet: &Sheet<'_>, sections: &[Section], several: bool) -> Markup {
    html! {
        article.run id=(sheet.anchor) aria-label={ "Run " (sheet.run.name) } {
            nav aria-label={ "Sections of " (sheet.run.name) } {
                @if several { strong { (sheet.run.name) } }
                ol {
                    @for section in sections { li { a href={ "#" (sheet.section_id(section.id)) } { (section.title) } } }
                }
            }
            div.sections {
                @if several { h2.run-name { (sheet.run.name) } }
                @for section in sections {
                    section id=(sheet.section_id(section.id)) data-section=(section.id) {
                        h2 { (section.title) }
                        (section.body)
                    }
                }
            }
        }
    }
}

/// The colours as CSS variables, for light pages, dark ones and paper.
fn colours() -> String {
    let list = |pick: fn(&(&str, &'static str, &'static str)) -> &'static str| -> String {
        COLOURS.iter().map(|colour| format!("--{}:{};", colour.0, pick(colour))).collect()
    };
    let (light, dark) = (list(|colour| colour.1), list(|colour| colour.2));
    format!(":root{{{light}}}\n@media screen and (prefers-color-scheme: dark){{:root{{{dark}}}}}\n")
}

/// three.js as text, which `replay.js` makes a module of.
fn three() -> Markup {
    html! {
        script #three-js type="text/plain" { (PreEscaped(THREE_MODULE_JS)) }
        script #orbit-controls-js type="text/plain" { (PreEscaped(ORBIT_CONTROLS_JS)) }
    }
}

fn footer(replays: bool) -> Markup {
    html! {
        p {
            "Written by elo " (env!("CARGO_PKG_VERSION")) " (" code { "elo report" } "). The method is from Weber, Martin, "
            "Torresen and da Silva, " cite { "Identifying Reusable Early-Life Options" } ", 2019."
        }
        @if replays {
            details {
                summary { "Licence of three.js " (THREE_VERSION) ", with which the replay is drawn" }
                pre { (include_str!("three-licence.txt")) }
            }
        }
    }
}
