//! Dates and times in UTC.

/// Seconds of a day.
const DAY: i64 = 86_400;

/// Year, month and day, then hour, minute and second in UTC from Unix seconds (civil calendar from days, Hinnant 2021).
pub fn date_time(unix_s: i64) -> [i64; 6] {
    // Counting years from March puts the leap day at the end.
    let (days, second) = (unix_s.div_euclid(DAY) + 719_468, unix_s.rem_euclid(DAY));
    let (era, day) = (days.div_euclid(146_097), days.rem_euclid(146_097));
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let march = (5 * day + 2) / 153;
    let day = day - (153 * march + 2) / 5 + 1;
    let month = if march < 10 { march + 3 } else { march - 9 };
    [400 * era + year + i64::from(month <= 2), month, day, second / 3600, second / 60 % 60, second % 60]
}

/// Days from 1970-01-01 to a date of the Gregorian calendar (the inverse of [`date_time`]).
pub fn days(year: i64, month: i64, day: i64) -> i64 {
    let year = if month <= 2 { year - 1 } else { year };
    let march = (month + 9) % 12;
    let (era, of_era) = (year.div_euclid(400), year.rem_euclid(400));
    let of_year = (153 * march + 2) / 5 + day - 1;
    era * 146_097 + 365 * of_era + of_era / 4 - of_era / 100 + of_year - 719_468
}

/// ISO 8601 time in UTC from Unix seconds: `2024-02-29T23:59:59Z`.
pub fn iso(unix_s: i64) -> String {
    let [year, month, day, hour, minute, second] = date_time(unix_s);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z")
}

/// Date and time for people: `2024-02-29 23:59 UTC`.
pub fn minutes(unix_s: i64) -> String {
    let [year, month, day, hour, minute, _] = date_time(unix_s);
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02} UTC")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_those_of_the_calendar() {
        for (seconds, date) in [
            (0, "1970-01-01T00:00:00Z"),
            (-1, "1969-12-31T23:59:59Z"),
            (951_782_400, "2000-02-29T00:00:00Z"),
            (1_709_251_199, "2024-02-29T23:59:59Z"),
            (1_709_251_200, "2024-03-01T00:00:00Z"),
            (1_735_689_599, "2024-12-31T23:59:59Z"),
            (4_107_542_400, "2100-03-01T00:00:00Z"),
        ] {
            assert_eq!(iso(seconds), date);
        }
        for day in -200_000..200_000 {
            let [year, month, of_month, ..] = date_time(day * DAY);
            assert_eq!(days(year, month, of_month), day);
        }
        assert_eq!(minutes(951_827_696), "2000-02-29 12:34 UTC");
    }
}
