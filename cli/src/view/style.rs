//! Colours, sizes and names of controls: dark and calm, so that the face stands out.

use egui::{Color32, Context, Response, Stroke, Theme, Visuals, vec2};

pub const PANEL: Color32 = Color32::from_rgb(0x17, 0x19, 0x1e);
pub const PLATE: Color32 = Color32::from_rgb(0x1e, 0x21, 0x27);
pub const GRID: Color32 = Color32::from_rgb(0x33, 0x38, 0x41);
pub const INK: Color32 = Color32::from_rgb(0xd9, 0xdd, 0xe4);
pub const DIM: Color32 = Color32::from_rgb(0x8c, 0x94, 0xa1);
pub const ACCENT: Color32 = Color32::from_rgb(0x5c, 0xb8, 0xa7);
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
        style.spacing.item_spacing = vec2(8.0, 6.0);
        style.spacing.interact_size.y = 22.0;
        style.spacing.slider_rail_height = 4.0;
        let mut visuals = Visuals::dark();
        visuals.panel_fill = PANEL;
        visuals.window_fill = PLATE;
        visuals.window_stroke = Stroke::new(1.0, GRID);
        visuals.slider_trailing_fill = true;
        visuals.override_text_color = Some(INK);
        style.visuals = visuals;
    });
}

/// Names a control for those who cannot see what is beside it, and for tests.
pub fn called(response: &Response, name: &str) -> Response {
    response.ctx.accesskit_node_builder(response.id, |node| node.set_label(name));
    response.clone()
}
