//! Plots as SVG: the look that all of them share, their data as CSV, and the two forms in which they leave.

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use kuva::prelude::{
    Layout, LegendPosition, Plot, SvgBackend, Theme, TickFormat, collect_legend_entries, render_multiple,
};
use kuva::render::layout::ComputedLayout;
use kuva::render::render::{PathData, Primitive};
use maud::{Markup, PreEscaped, html};

/// Colours by name, for light and dark pages: Okabe and Ito's, which colour-blind people can tell apart, made darker or
/// lighter where the contrast with the page asks for it.
pub const COLOURS: [(&str, &str, &str); 12] = [
    ("c1", "#0072b2", "#56b4e9"),
    ("c2", "#d55e00", "#ff8b3d"),
    ("c3", "#007e5d", "#2fcf9f"),
    ("c4", "#b0518a", "#e79fc8"),
    ("c5", "#a87900", "#f0c33c"),
    ("c6", "#3f8fc4", "#9cc9e8"),
    ("c7", "#767676", "#a3a3a3"),
    ("c8", "#222222", "#f2f2f2"),
    ("ink", "#1c1c1c", "#ececec"),
    ("soft", "#5a5a5a", "#b4b4b4"),
    ("grid", "#e2e2e2", "#3a3a3a"),
    ("paper", "#ffffff", "#161616"),
];

/// The CSS name of a colour.
pub fn colour(name: &str) -> String {
    format!("var(--{name})")
}

/// The colour of the `index`-th of several things.
pub fn nth_colour(index: usize) -> String {
    format!("var(--c{})", index % 8 + 1)
}

/// A plot before it is drawn.
pub struct Chart {
    /// Unique on the page, and the name of its files.
    pub id: String,
    /// What it shows, in a few words.
    pub title: String,
    /// What it shows, for those who do not see it.
    pub description: String,
    /// Axes and size.
    pub layout: Layout,
    /// What is drawn.
    pub plots: Vec<Plot>,
    /// Short strokes that show single values, above everything.
    pub rugs: Vec<Rug>,
    /// Its data.
    pub csv: String,
}

/// A stroke at each value.
pub struct Rug {
    /// Where, along x.
    pub values: Vec<f64>,
    /// The end of the strokes along y.
    pub at: f64,
    /// Their length in pixels, downwards.
    pub length: f64,
    /// Their colour.
    pub colour: String,
}

/// A plot that is ready.
#[derive(Clone, Debug)]
pub struct Figure {
    /// The name of its files, without an ending.
    pub id: String,
    title: String,
    svg: String,
    csv: String,
}

/// Axes of this size over these ranges, with the look of the page.
pub fn layout(size: (f64, f64), x: (f64, f64), y: (f64, f64)) -> Layout {
    let theme = Theme {
        background: "none".into(),
        axis_color: colour("soft"),
        grid_color: colour("grid"),
        tick_color: colour("soft"),
        text_color: colour("ink"),
        legend_bg: "none".into(),
        legend_border: "none".into(),
        font_family: Some("system-ui, sans-serif".into()),
        ..Theme::light()
    };
    Layout::new(x, y)
        .with_theme(theme)
        .with_width(size.0)
        .with_height(size.1)
        .with_x_axis_min(x.0)
        .with_x_axis_max(x.1)
        .with_y_axis_min(y.0)
        .with_y_axis_max(y.1)
        .with_label_size(13)
        .with_tick_size(12)
        .with_body_size(12)
        .with_legend_position(LegendPosition::OutsideBottomColumns)
}

/// A step of 1, 2 or 5 times a power of ten that cuts `span` into about `parts`.
pub fn nice_step(span: f64, parts: f64) -> f64 {
    let raw = (span / parts).abs().max(f64::MIN_POSITIVE);
    let power = 10f64.powf(raw.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|step| *step >= raw * 0.999).unwrap_or(raw)
}

/// The range of `values` with a margin of `share` of it on both sides; never empty.
pub fn padded(values: impl Iterator<Item = f64>, share: f64) -> (f64, f64) {
    let (low, high) = values
        .filter(|value| value.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
    if low > high {
        return (0.0, 1.0);
    }
    let span = if high > low { high - low } else { high.abs().max(1.0) };
    (low - share * span, high + share * span)
}

/// `250k` for steps of training.
pub fn steps_format() -> TickFormat {
    let text = |value: f64| match value.abs() {
        v if v >= 1e6 => format!("{}M", value / 1e6),
        v if v >= 1e3 => format!("{}k", value / 1e3),
        _ => format!("{value}"),
    };
    TickFormat::Custom(std::sync::Arc::new(text))
}

/// A table as CSV.
pub fn csv(header: &[&str], rows: impl IntoIterator<Item = Vec<String>>) -> String {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let memory = "writing to memory cannot fail";
    writer.write_record(header).expect(memory);
    for row in rows {
        writer.write_record(row).expect(memory);
    }
    String::from_utf8(writer.into_inner().expect(memory)).expect("text in, text out")
}

impl Chart {
    /// Draws it.
    pub fn draw(self) -> Figure {
        let Self { id, title, description, layout, plots, rugs, csv } = self;
        let legend = collect_legend_entries(&plots);
        let layout = if legend.is_empty() { layout } else { layout.with_legend_entries(legend) };
        let computed = ComputedLayout::from_layout(&layout);
        let mut scene = render_multiple(plots, layout);
        scene.elements.extend(rugs.iter().map(|rug| rug.strokes(&computed)));
        let svg = SvgBackend::new().render_scene(&scene);
        let body = svg.split_once('>').map_or("", |(_, rest)| rest);
        // Clips are named from 0 in every plot, and a page has many plots.
        let body = body.replace("kuva-clip-", &format!("clip-{id}-"));
        let (width, height) = (scene.width, scene.height);
        let open = html! {
            (PreEscaped(format!(
                "<svg xmlns=\"http://www.w3.org/2000/svg\" role=\"img\" viewBox=\"0 0 {width:.0} {height:.0}\" \
                 width=\"{width:.0}\" height=\"{height:.0}\" font-family=\"system-ui, sans-serif\" fill=\"var(--ink)\" \
                 aria-labelledby=\"title-{id} desc-{id}\">"
            )))
            title id={ "title-" (id) } { (title) }
            desc id={ "desc-" (id) } { (description) }
        };
        Figure { svg: open.into_string() + &body, id, title, csv }
    }
}

impl Rug {
    fn strokes(&self, layout: &ComputedLayout) -> Primitive {
        let y = layout.map_y(self.at);
        let stroke = |x: &f64| format!("M{:.1} {y:.1}v{:.1}", layout.map_x(*x), self.length);
        Primitive::Path(Box::new(PathData {
            d: self.values.iter().map(stroke).collect(),
            fill: None,
            stroke: self.colour.clone().into(),
            stroke_width: 1.0,
            // Where there are very many, only those that coincide are dark.
            opacity: Some((60.0 / self.values.len().max(1) as f64).clamp(0.1, 0.5)),
            stroke_dasharray: None,
        }))
    }
}

impl Figure {
    /// As the page holds it: it follows the page's colours.
    pub fn markup(&self) -> Markup {
        html! {
            figure.plot id={ "plot-" (self.id) } {
                div.scroll tabindex="0" role="group" aria-label=(self.title) { (PreEscaped(&self.svg)) }
                figcaption {
                    (self.title) " "
                    span.links {
                        a download={ (self.id) ".svg" } href=(data_uri("image/svg+xml", &self.standalone())) { "SVG" }
                        " "
                        a download={ (self.id) ".csv" } href=(data_uri("text/csv", &self.csv)) { "CSV" }
                    }
                }
            }
        }
    }

    /// As a file of its own, in the colours of a light page.
    pub fn standalone(&self) -> String {
        let paper = "</desc><rect width=\"100%\" height=\"100%\" fill=\"var(--paper)\"/>";
        let svg = self.svg.replacen("</desc>", paper, 1);
        COLOURS.iter().fold(svg, |svg, (name, light, _)| svg.replace(&format!("var(--{name})"), light)) + "\n"
    }

    /// Its data.
    pub fn csv(&self) -> &str {
        &self.csv
    }
}

/// A file inside of a link.
pub fn data_uri(kind: &str, text: &str) -> String {
    format!("data:{kind};charset=utf-8;base64,{}", BASE64_STANDARD.encode(text))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_nice() {
        assert_eq!([nice_step(1.0, 5.0), nice_step(900.0, 5.0), nice_step(0.37, 10.0)], [0.2, 200.0, 0.05]);
    }

    #[test]
    fn ranges_are_never_empty() {
        assert_eq!(padded([3.0, 3.0].into_iter(), 0.1), (2.7, 3.3));
        assert_eq!(padded([].into_iter(), 0.1), (0.0, 1.0));
        assert_eq!(padded([f64::NAN, 0.0, 10.0].into_iter(), 0.1), (-1.0, 11.0));
    }

    #[test]
    fn a_plot_is_named_for_readers_and_free_of_the_pages_colours_as_a_file() {
        let line =
            kuva::prelude::LinePlot::new().with_data([(0.0, 0.0), (1.0, 1.0)]).with_color(colour("c1"));
        let chart = Chart {
            id: "one".to_owned(),
            title: "A <line>".to_owned(),
            description: "It rises.".to_owned(),
            layout: layout((300.0, 200.0), (0.0, 1.0), (0.0, 1.0)),
            plots: vec![line.into()],
            rugs: vec![Rug { values: vec![0.5], at: 0.0, length: 6.0, colour: colour("c2") }],
            csv: csv(&["x", "y"], [vec!["0".to_owned(), "a,b".to_owned()]]),
        };
        let figure = chart.draw();
        assert!(figure.svg.contains("A &lt;line&gt;</title>") && figure.svg.contains("var(--c1)"));
        assert!(figure.svg.contains("clip-one-0") && !figure.svg.contains("kuva-clip"));
        assert!(!figure.standalone().contains("var("));
        assert_eq!(figure.csv(), "x,y\n0,\"a,b\"\n");
    }
}
