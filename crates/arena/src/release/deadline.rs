//! The deadline of a challenge: a day, over when it has ended everywhere on Earth (12:00 UTC on the next day).

use std::time::SystemTime;

use chrono::{DateTime, Days, NaiveDate, NaiveTime, Utc};

/// The last day of a challenge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Deadline(NaiveDate);

/// How long the day lasts in the last time zone (UTC-12), in words.
pub(crate) const UNTIL: &str = "the end of that day anywhere on Earth, 12:00 UTC on the next day";

impl std::str::FromStr for Deadline {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let date = NaiveDate::parse_from_str(text, "%Y-%m-%d").ok();
        // Not with a sign, fewer digits or spaces.
        let date = date.filter(|date| date.to_string() == text);
        date.map(Deadline).ok_or_else(|| format!("{text:?}: expected a date, such as 2027-03-01"))
    }
}

impl std::fmt::Display for Deadline {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

impl Deadline {
    /// When it is over.
    pub(super) fn end(self) -> DateTime<Utc> {
        let noon = NaiveTime::from_hms_opt(12, 0, 0).unwrap_or_default();
        // Years have four digits, so there is a next day.
        self.0.checked_add_days(Days::new(1)).unwrap_or(self.0).and_time(noon).and_utc()
    }

    pub(crate) fn has_passed(self, now: SystemTime) -> bool {
        DateTime::<Utc>::from(now) >= self.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn a_day_ends_when_it_has_ended_everywhere() {
        let deadline: Deadline = "2028-02-28".parse().unwrap();
        assert_eq!(deadline.to_string(), "2028-02-28");
        // `date -u -d '2028-02-29 12:00' +%s`, in a leap year.
        let end = SystemTime::UNIX_EPOCH + Duration::from_secs(1_835_438_400);
        assert!(deadline.has_passed(end) && !deadline.has_passed(end - Duration::from_secs(1)));
    }

    #[test]
    fn what_is_no_date_is_refused() {
        for wrong in
            ["", "2027-02-29", "2027-3-1", "01.03.2027", "2027-03-01T12:00", " 2027-03-01", "+2027-03-01"]
        {
            let error = wrong.parse::<Deadline>().unwrap_err();
            assert!(error.contains("expected a date, such as 2027-03-01"), "{error}");
        }
        assert!("9999-12-31".parse::<Deadline>().is_ok_and(|last| !last.has_passed(SystemTime::now())));
    }
}
