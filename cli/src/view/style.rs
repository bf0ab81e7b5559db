//! Colours and sizes: dark and calm, so that the face stands out.

use egui::{Color32, Context, CornerRadius, FontFamily, FontId, Margin, Stroke, TextStyle, Theme, Visuals, vec2};

pub const PANEL: Color32 = Color32::from_rgb(0x17, 0x19, 0x1e);
pub const PLATE: Color32 = Color32::from_rgb(0x1e, 0x21, 0x27);
pub const GRID: Color32 = Color32::from_rgb(0x33, 0x38, 0x41);
pub const INK: Color32 = Color32::from_rgb(0xd9, 0xdd, 0xe4);
pub const DIM: Color32 = Color32::from_rgb(0x8c, 0x94, 0xa1);
pub const ACCENT: Color32 = Color32::from_rgb(0x5c, 0xb8, 0xa7);
/// Colour of the full evaluation in plots.
pub const FULL: Color32 = Color32::from_rgb(0xd0, 0x9a, 0x5b);
pub const ERROR: Color32 = Color32::from_rgb(0xe5, 0x7b, 0x6e);
/// Background of the instances, in sRGB.
pub const BEHIND: [u8; 3] = [0x23, 0x26, 0x2d];

/// Applies the style. `still`: without animation, so that every run of a script looks the same.
pub fn apply(context: &Context, still: bool) {
    context.set_theme(Theme::Dark);
    context.style_mut_of(Theme::Dark, |style| {
        if still {
            style.animation_time = 0.0;
        }
        let font = |size| FontId::new(size, FontFamily::Proportional);
        style.text_styles = [
            (TextStyle::Small, font(11.5)),
            (TextStyle::Body, font(13.5)),
            (TextStyle::Button, font(13.5)),
            (TextStyle::Heading, font(19.0)),
            (TextStyle::Monospace, FontId::new(12.5, FontFamily::Monospace)),
        ]
        .into();
        style.spacing.item_spacing = vec2(8.0, 6.0);
        style.spacing.button_padding = vec2(9.0, 3.0);
        style.spacing.interact_size.y = 22.0;
        style.spacing.slider_rail_height = 4.0;
        style.spacing.window_margin = Margin::same(10);
        let mut visuals = Visuals::dark();
        visuals.panel_fill = PANEL;
        visuals.window_fill = PLATE;
        visuals.extreme_bg_color = Color32::from_rgb(0x10, 0x12, 0x16);
        visuals.faint_bg_color = PLATE;
        visuals.window_stroke = Stroke::new(1.0, GRID);
        visuals.selection.bg_fill = Color32::from_rgb(0x2c, 0x5a, 0x54);
        visuals.selection.stroke = Stroke::new(1.0, INK);
        visuals.slider_trailing_fill = true;
        let widgets = &mut visuals.widgets;
        widgets.noninteractive.fg_stroke.color = INK;
        widgets.noninteractive.bg_stroke.color = GRID;
        for widget in [&mut widgets.inactive, &mut widgets.hovered, &mut widgets.active, &mut widgets.open] {
            widget.corner_radius = CornerRadius::same(4);
            widget.fg_stroke.color = INK;
            widget.bg_stroke = Stroke::NONE;
        }
        widgets.inactive.bg_fill = Color32::from_rgb(0x2b, 0x2f, 0x37);
        widgets.inactive.weak_bg_fill = Color32::from_rgb(0x26, 0x2a, 0x31);
        widgets.hovered.weak_bg_fill = Color32::from_rgb(0x31, 0x37, 0x40);
        style.visuals = visuals;
    });
}
