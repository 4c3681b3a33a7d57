//! Values over two variables: as a plot of coloured cells and as a table of comma-separated values.

use std::fmt::Write;

/// A value for each row and column.
#[derive(Clone, Debug, PartialEq)]
pub struct HeatMap {
    /// The file's name without its suffix.
    pub name: String,
    /// Title.
    pub title: String,
    /// Quantity of the columns, with the unit.
    pub x_axis: String,
    /// Values of the columns, ascending.
    pub x: Vec<f64>,
    /// Labels of the rows, from the top down.
    pub rows: Vec<String>,
    /// Quantity of the cells, with the unit.
    pub value: String,
    /// The values of the darkest and the brightest colour.
    pub range: [f64; 2],
    /// For each row a value a column; NaN where there is none.
    pub values: Vec<Vec<f64>>,
}

impl HeatMap {
    /// As CSV: a line for each row, a column for each x; a cell without a value is empty.
    pub fn csv(&self) -> String {
        let plain = |text: &str| text.replace(',', ";");
        let mut text = format!("{} \\ {}", plain(&self.value), plain(&self.x_axis));
        self.x.iter().for_each(|x| {
            let _ = write!(text, ",{x}");
        });
        text.push('\n');
        for (row, values) in self.rows.iter().zip(&self.values) {
            text += &plain(row);
            for value in values {
                let _ =
                    if value.is_nan() { write!(text, ",") } else { write!(text, ",{value:.6}") };
            }
            text.push('\n');
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_drawn_except_where_there_is_no_value() {
        let map = HeatMap {
            name: "name".into(),
            title: "title".into(),
            x_axis: "height / km".into(),
            x: vec![160.0, 2000.0, 20_200.0],
            rows: vec!["GN".into(), "AW-DGN, BT".into()],
            value: "iterations".into(),
            range: [4.0, 8.0],
            values: vec![vec![f64::NAN, f64::NAN, 6.0], vec![7.0, 7.5, 20.0]],
        };
        assert_eq!(
            map.csv(),
            "iterations \\ height / km,160,2000,20200\nGN,,,6.000000\n\
             AW-DGN; BT,7.000000,7.500000,20.000000\n"
        );
        let svg = map.svg().unwrap();
        let empty = HeatMap { values: vec![vec![f64::NAN; 3]; 2], ..map };
        let rectangles = |svg: &str| svg.matches("<rect").count();
        assert_eq!(rectangles(&svg), rectangles(&empty.svg().unwrap()) + 4);
        assert!(svg.contains("height / km") && svg.contains("iterations"));
    }
}
