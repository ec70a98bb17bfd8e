//! Which share of the objects a process takes.

use crate::generate::Part;
use anyhow::{Context, bail};

/// This process's share: the flag, or what a Slurm array task or a Kubernetes indexed job says.
pub(crate) fn part(flag: Option<&str>, environment: impl Fn(&str) -> Option<String>) -> anyhow::Result<Part> {
    let number = |name: &str| -> anyhow::Result<Option<usize>> {
        environment(name)
            .map(|text| {
                text.trim()
                    .parse()
                    .with_context(|| format!("environment variable {name} is {text:?}, expected a number"))
            })
            .transpose()
    };
    let (index, count, origin) = if let Some(text) = flag {
        let numbers = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        let Some((index, count)) = numbers else {
            bail!("--part {text:?}: expected I/N, e.g. 0/4");
        };
        (index, count, format!("--part {text}"))
    } else if let (Some(id), Some(count)) = (number("SLURM_ARRAY_TASK_ID")?, number("SLURM_ARRAY_TASK_COUNT")?) {
        let (first, step) =
            (number("SLURM_ARRAY_TASK_MIN")?.unwrap_or(0), number("SLURM_ARRAY_TASK_STEP")?.unwrap_or(1));
        (id.saturating_sub(first) / step.max(1), count, format!("Slurm array task {id} of {count}"))
    } else if let Some(index) = number("JOB_COMPLETION_INDEX")? {
        let Some(count) = number("JOB_COMPLETIONS")? else {
            bail!(
                "JOB_COMPLETION_INDEX is {index}, but Kubernetes does not say of how many: set JOB_COMPLETIONS to the \
                 job's completions, or give --part $(JOB_COMPLETION_INDEX)/N"
            );
        };
        (index, count, format!("completion {index} of {count}"))
    } else {
        return Ok(Part::WHOLE);
    };
    if index >= count {
        bail!("{origin}: expected an index from 0 to {}", count.saturating_sub(1));
    }
    Ok(Part { index, count })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_from_flag_slurm_and_kubernetes() {
        let of = |flag: Option<&str>, variables: &[(&str, &str)]| {
            part(flag, |name| variables.iter().find(|v| v.0 == name).map(|v| v.1.to_owned()))
        };
        assert_eq!(of(None, &[]).unwrap(), Part::WHOLE);
        assert_eq!(of(Some("2/4"), &[("SLURM_ARRAY_TASK_ID", "0")]).unwrap(), Part { index: 2, count: 4 });
        let slurm = [
            ("SLURM_ARRAY_TASK_ID", "7"),
            ("SLURM_ARRAY_TASK_COUNT", "4"),
            ("SLURM_ARRAY_TASK_MIN", "1"),
            ("SLURM_ARRAY_TASK_STEP", "2"),
        ];
        assert_eq!(of(None, &slurm).unwrap(), Part { index: 3, count: 4 });
        let job = [("JOB_COMPLETION_INDEX", "1"), ("JOB_COMPLETIONS", "3")];
        assert_eq!(of(None, &job).unwrap(), Part { index: 1, count: 3 });
        assert!(of(None, &job[..1]).unwrap_err().to_string().contains("JOB_COMPLETIONS"));
        assert!(of(Some("4/4"), &[]).unwrap_err().to_string().contains("0 to 3"));
        assert!(of(Some("x"), &[]).unwrap_err().to_string().contains("expected I/N"));
    }
}
