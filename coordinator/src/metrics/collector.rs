//! The metrics at one moment, as the crate prometheus-client writes them.

use std::fmt;
use std::sync::Arc;

use prometheus_client::collector;
use prometheus_client::encoding::{DescriptorEncoder, NoLabelSet};
use prometheus_client::metrics::MetricType;

use super::families::{FAMILIES, Samples};
use super::source::MetricsSource;

/// Asks the source at each scrape.
#[derive(Debug)]
pub struct Collector(pub Arc<MetricsSource>);

impl collector::Collector for Collector {
    fn encode(&self, mut encoder: DescriptorEncoder<'_>) -> fmt::Result {
        let now = self.0.snapshot();
        for family in &FAMILIES {
            let samples = (family.samples)(&now, self.0.started);
            let kind = match &samples {
                Samples::Counters(_) => MetricType::Counter,
                Samples::Gauges(_) => MetricType::Gauge,
                Samples::Histograms(_) => MetricType::Histogram,
                Samples::Info(_) => MetricType::Info,
            };
            let mut metric = encoder.encode_descriptor(family.name(), family.help, None, kind)?;
            match samples {
                Samples::Counters(samples) => {
                    for (labels, count) in samples {
                        metric.encode_family(&labels)?.encode_counter::<NoLabelSet, _, u64>(&count, None)?;
                    }
                }
                Samples::Gauges(samples) => {
                    for (labels, value) in samples {
                        metric.encode_family(&labels)?.encode_gauge(&value)?;
                    }
                }
                Samples::Histograms(samples) => {
                    for (labels, times) in samples {
                        let buckets: Vec<(f64, u64)> = times.buckets().collect();
                        let (sum, count) = (times.sum(), times.count());
                        let mut metric = metric.encode_family(&labels)?;
                        metric.encode_histogram::<NoLabelSet>(sum, count, &buckets, None)?;
                    }
                }
                Samples::Info(labels) => metric.encode_info(&labels)?,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use prometheus_client::encoding::{prometheus_text, text};
    use prometheus_client::registry::Registry;

    use super::*;

    #[test]
    fn both_formats_have_every_metric_and_no_name_breaks_out_of_its_label() {
        let source = Arc::new(MetricsSource::default());
        source.run("seed\"} 1\n\\").generation_done(7, 0.25);
        let mut registry = Registry::default();
        registry.register_collector(Box::new(Collector(source)));
        let (mut openmetrics, mut prometheus) = (String::new(), String::new());
        text::encode(&mut openmetrics, &registry).unwrap();
        prometheus_text::encode(&mut prometheus, &registry).unwrap();
        assert!(openmetrics.ends_with("\n# EOF\n"), "{openmetrics}");
        for body in [&openmetrics, &prometheus] {
            assert_eq!(body.matches("# TYPE ").count(), FAMILIES.len());
            let generation = "\ndescry_generation{run=\"seed\\\"} 1\\n\\\\\"} 7.0\n";
            assert!(body.contains(generation), "{body}");
            assert!(body.contains("\ndescry_attempts_total{kind=\"tile\",outcome=\"late\"} 0\n"), "{body}");
            assert!(body.contains("\ndescry_queue_wait_seconds_bucket{le=\"+Inf\"} 0\n"), "{body}");
        }
        assert!(prometheus.contains("\n# TYPE descry_leases_total counter\n"), "{prometheus}");
    }
}
