//! Pages that need nothing but themselves: what the reports of `bench` and `info` share.

use crate::plots::Figure;
use crate::table::Table;
use maud::{DOCTYPE, Markup, PreEscaped, html};

pub fn document(title: &str, body: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (title) }
                style { (PreEscaped(include_str!("page.css"))) }
            }
            body { main { (body) } }
        }
    };
    page.into_string()
}

/// Figures with their SVG, their captions, and links to the files beside the page.
pub fn figures(drawn: &[(Figure, String)]) -> Markup {
    html! {
        section.figures {
            @for (figure, svg) in drawn {
                figure id=(figure.slug) {
                    div.plot role="img" aria-label=(figure.title) {
                        // Without its XML declaration.
                        (PreEscaped(&svg[svg.find("<svg").unwrap_or(0)..]))
                    }
                    figcaption {
                        (figure.caption) " "
                        a href={ (figure.slug) ".png" } { "PNG" } " "
                        a href={ (figure.slug) ".svg" } { "SVG" }
                    }
                }
            }
        }
    }
}

/// A table; `rows` are `tr` elements.
pub fn table<'a>(headings: impl IntoIterator<Item = &'a str>, rows: impl IntoIterator<Item = Markup>) -> Markup {
    html! {
        div.scroll {
            table {
                thead { tr { @for heading in headings { th { (heading) } } } }
                tbody { @for row in rows { (row) } }
            }
        }
    }
}

/// A text table on a page.
pub fn text_table(text: &Table) -> Markup {
    table(text.headings(), text.rows().iter().map(|cells| html! { tr { @for cell in cells { td { (cell) } } } }))
}
