//! What colours over the instances mean.

use super::command::Look;
use super::panel::About;
use super::state::State;
use super::style::{DIM, INK, PLATE};
use crate::table::sig3;
use deltamorph_render::heat;
use egui::{Align2, Color32, CornerRadius, FontId, Rect, Ui, pos2, vec2};

/// Width and height of the scale.
const SCALE: [f32; 2] = [150.0, 8.0];

/// Its words, and where the colours end, in input units.
fn words(look: Look, reach: f32) -> Option<(&'static str, Option<f32>)> {
    match look {
        Look::Heat => Some(("distance from the base pose", Some(reach))),
        Look::Motion => Some(("way since the frame before", Some(motion_end(reach)))),
        Look::Wrinkles => Some(("wrinkles where the pose compresses the skin", None)),
        Look::Blocks => Some(("orange: blocks of vertices that this frame writes, fading afterwards", None)),
        Look::Normals => Some(("red, green, blue: to the right, up, towards the front", None)),
        Look::Shaded | Look::Wire => None,
    }
}

/// Where the colours of motion end, of a mesh whose targets reach so far.
pub fn motion_end(reach: f32) -> f32 {
    reach * 0.1
}

/// Draws the legend into the lower left corner of the room for the instances.
pub fn show(ui: &Ui, free: Rect, state: &State, about: &About<'_>) {
    let Some((text, end)) = words(state.look, about.reach) else { return };
    let (painter, small) = (ui.painter_at(free), FontId::proportional(11.5));
    let text = painter.layout(text.to_owned(), small.clone(), INK, (free.width() - 40.0).max(60.0));
    let ends = end.map(|end| {
        let share = f64::from(100.0 * end / state.input.kept.diagonal.max(f32::MIN_POSITIVE));
        let text = format!("{} ({}% of the diagonal)", sig3(f64::from(end)), sig3(share));
        painter.layout_no_wrap(text, small.clone(), DIM)
    });
    let scale = if ends.is_some() { SCALE[1] + 20.0 } else { 0.0 };
    let wide = text.size().x.max(ends.as_ref().map_or(0.0, |ends| (ends.size().x + 24.0).max(SCALE[0])));
    let size = vec2(wide, text.size().y + scale);
    let plate = Rect::from_min_size(free.left_bottom() + vec2(18.0, -18.0 - size.y), size);
    painter.rect_filled(plate.expand(8.0), CornerRadius::same(6), PLATE.gamma_multiply(0.85));
    let under = plate.top() + text.size().y + 5.0;
    painter.galley(plate.left_top(), text, INK);
    if let Some(ends) = ends {
        let step = wide / 64.0;
        for i in 0..64u8 {
            let [r, g, b] = heat(f32::from(i) / 63.0);
            let bar = Rect::from_min_size(pos2(plate.left() + f32::from(i) * step, under), vec2(step + 0.5, SCALE[1]));
            painter.rect_filled(bar, CornerRadius::ZERO, Color32::from_rgb(r, g, b));
        }
        let y = under + SCALE[1] + 2.0;
        painter.text(pos2(plate.left(), y), Align2::LEFT_TOP, "0", small, DIM);
        painter.galley(pos2(plate.right() - ends.size().x, y), ends, DIM);
    }
}
