//! The picture of a step's response, as SVG.

use std::path::Path;

use plotters::prelude::*;

use crate::step::Sample;

/// Draws a step into an SVG file: the value and the target above, the duty below.
///
/// # Errors
/// Says in one line what is wrong with the file.
pub(super) fn draw(
    file: &Path,
    title: &str,
    unit: &str,
    samples: &[Sample],
    target: f64,
) -> Result<(), String> {
    let mut text = String::new();
    plot(&mut text, title, unit, samples, target)
        .map_err(|error| format!("the picture: {error}"))?;
    std::fs::write(file, text).map_err(|error| format!("{}: {error}", file.display()))
}

fn plot(
    text: &mut String,
    title: &str,
    unit: &str,
    samples: &[Sample],
    target: f64,
) -> Result<(), Box<dyn std::error::Error>> {
    let end = samples.last().map_or(1.0, |sample| sample.time.as_secs_f64()).max(0.1);
    let values = || samples.iter().map(|sample| sample.value).chain([target]);
    let (low, high) = (values().fold(f64::MAX, f64::min), values().fold(f64::MIN, f64::max));
    let margin = ((high - low) * 0.08).max(1.0);
    let root = SVGBackend::with_string(text, (800, 600)).into_drawing_area();
    root.fill(&WHITE)?;
    let (above, below) = root.split_vertically(400);
    let font = ("sans-serif", 16);
    let mut chart = ChartBuilder::on(&above)
        .caption(title, ("sans-serif", 20))
        .margin(12)
        .x_label_area_size(30)
        .y_label_area_size(70)
        .build_cartesian_2d(0.0..end, low - margin..high + margin)?;
    chart.configure_mesh().y_desc(unit).label_style(font).draw()?;
    chart.draw_series(LineSeries::new([(0.0, target), (end, target)], BLACK.mix(0.5)))?;
    let line = |of: fn(&Sample) -> f64| samples.iter().map(move |s| (s.time.as_secs_f64(), of(s)));
    chart.draw_series(LineSeries::new(line(|s| s.value), BLUE.stroke_width(2)))?;
    let mut chart = ChartBuilder::on(&below)
        .margin(12)
        .x_label_area_size(40)
        .y_label_area_size(70)
        .build_cartesian_2d(0.0..end, -105.0..105.0)?;
    chart.configure_mesh().y_desc("duty, %").x_desc("s").label_style(font).draw()?;
    chart.draw_series(LineSeries::new(line(|s| 100.0 * s.duty), RED.stroke_width(2)))?;
    drop(chart);
    root.present()?;
    drop((above, below, root));
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn the_picture_is_an_svg_with_two_lines_and_the_unit() {
        let mut text = String::new();
        let sample = |ms| Sample { time: Duration::from_millis(ms), value: ms as f64, duty: 0.5 };
        let samples: Vec<_> = (1..=100).map(sample).collect();
        plot(&mut text, "motor 1", "counts/s", &samples, 100.0).unwrap();
        assert!(text.starts_with("<svg") && text.trim_end().ends_with("</svg>"));
        assert!(text.matches("<polyline").count() >= 3 && text.contains("counts/s"));
    }
}
