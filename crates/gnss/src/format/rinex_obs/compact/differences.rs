//! Numbers as differences, and text as what changed.

/// Highest order of differences.
const HIGHEST_ORDER: usize = 9;
/// Values are smaller, in units of their last digit: 14 columns have room for no more.
const MOST: i64 = 10_000_000_000_000;

/// What an entry of a series says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Number {
    /// A value, in units of its last digit.
    Value(i64),
    /// There is none, and the series ends.
    Missing,
    /// The entry is no number, or the value is too large: the series is broken until it starts anew.
    Wrong,
    /// A difference, of a series that was not begun.
    NotBegun,
}

/// The values of one field, epoch by epoch.
#[derive(Default)]
pub(super) enum Series {
    #[default]
    Ended,
    /// A damaged entry came: differences that follow say nothing.
    Broken,
    Running {
        order: usize,
        /// The last value, its first difference, and so on.
        differences: Vec<i64>,
    },
}

impl Series {
    /// Takes the next entry: blank, `3&123456` to start a series of third differences, or a difference.
    pub fn take(&mut self, text: &str) -> Number {
        let number = self.entry(text);
        if number == Number::Wrong {
            *self = Self::Broken;
        }
        number
    }

    fn entry(&mut self, text: &str) -> Number {
        if text.is_empty() {
            *self = Self::Ended;
            return Number::Missing;
        }
        let (order, value) = match text.split_once('&') {
            Some((order, value)) => (order.parse().ok(), value),
            None => (None, text),
        };
        let Ok(value) = value.parse::<i64>() else { return Number::Wrong };
        match (order.filter(|order| *order <= HIGHEST_ORDER), self) {
            (Some(order), series) => {
                *series = Self::Running { order, differences: vec![value] };
                within(value)
            }
            (None, _) if text.contains('&') => Number::Wrong,
            (None, Self::Ended) => Number::NotBegun,
            (None, Self::Broken) => Number::Missing,
            (None, Self::Running { order, differences }) => sum(*order, differences, value),
        }
    }
}

/// The value that follows from the next difference, of the order reached.
fn sum(order: usize, differences: &mut Vec<i64>, next: i64) -> Number {
    if differences.len() <= order {
        differences.push(0);
    }
    let mut sum = next;
    for (k, difference) in differences.iter_mut().rev().enumerate() {
        // The highest is the entry itself.
        let total = if k == 0 { Some(next) } else { difference.checked_add(sum) };
        let Some(total) = total else { return Number::Wrong };
        (*difference, sum) = (total, total);
    }
    within(sum)
}

fn within(value: i64) -> Number {
    if (-MOST..MOST).contains(&value) { Number::Value(value) } else { Number::Wrong }
}

/// The text that comes of another by its changes: a blank keeps a character, `&` makes it blank.
pub(super) fn changed(before: &str, changes: &str) -> String {
    let mut text: Vec<char> = before.chars().collect();
    for (k, c) in changes.chars().enumerate() {
        if k == text.len() {
            text.push(' ');
        }
        match c {
            ' ' => {}
            '&' => text[k] = ' ',
            c => text[k] = c,
        }
    }
    text.into_iter().collect::<String>().trim_end().to_owned()
}

/// A number of `places` decimal places, in `width` columns.
pub(super) fn decimal(value: i64, places: usize, width: usize) -> String {
    let sign = if value < 0 { "-" } else { "" };
    let digits = format!("{:0>1$}", value.unsigned_abs(), places + 1);
    let (whole, part) = digits.split_at(digits.len() - places);
    let text = format!("{sign}{whole}.{part}");
    // RINEX drops the zero where there is no room for it.
    let text = if text.len() > width { text.replacen("0.", ".", 1) } else { text };
    format!("{text:>width$}")
}
