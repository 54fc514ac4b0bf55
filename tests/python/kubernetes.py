"""Checks the manifests of deploy/kubernetes, without a cluster, and runs the programs as the manifests start them.

Usage: kubernetes.py PROGRAMS OUT_DIR

PROGRAMS is the folder of `coordinator` and `worker`, for example target/release. Needs root, kubectl (whose `kustomize` builds
the objects), promtool, and PyPI's kubernetes-validate and PyYAML (PYTHONPATH). Each object is validated against the schemas
of all versions since 1.29 that kubernetes-validate has, unknown fields refused, and against the others: selectors, ports, volumes,
arguments, sizes. Each check is shown to fail on objects that are broken on purpose. Then the demo is carried out by
coordinator and worker as the manifests start them: arguments, user, no capabilities, a read-only root, mounts as kubelet
lays them out, a network of their own. What is not checked: schedulers, volumes and networks of a cluster. Two minutes.
"""

import argparse
import base64
import copy
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tomllib

import waiting
import yaml
from kubernetes_validate import utils as schemas

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
SOURCE = REPOSITORY / "deploy/kubernetes"
BESIDE = ("copy-results.yaml",)  # objects that nobody needs before the run has ended
# In the schemas of earlier ones, each rule of a Job's failure policy must have conditions of pods.
OLDEST = "1.29.0"
DEMO = "3266a896a19e77b6a9e4d64931f94eb4b669a4ed783e04c35aee3ef41f71d9a3"
ADDRESS = "198.51.100.1"
PATIENCE = 120  # seconds
UNITS = {"": 1, "Ki": 1 << 10, "Mi": 1 << 20, "Gi": 1 << 30, "MiB": 1 << 20, "GiB": 1 << 30}
# What the image sets.
ENVIRONMENT = {"HOME": "/data", "DESCRY_CACHE": "/cache"}
COMPONENT = "app.kubernetes.io/component"


def run(*command, code=0, **more):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=PATIENCE, **more)
    if code is not None and done.returncode != code:
        raise SystemExit(f"{command}: must end with {code}, got {done.returncode}\n{done.stdout}{done.stderr}")
    return done


def say(what):
    print(what, flush=True)


def build(folder):
    """All objects of a kustomization, and those beside it."""
    objects = list(yaml.safe_load_all(run("kubectl", "kustomize", folder).stdout))
    for name in BESIDE:
        objects += yaml.safe_load_all((folder / name).read_text())
    return objects


def size(text):
    number, unit = re.fullmatch(r"([0-9.]+)([A-Za-z]*)", str(text)).groups()
    return float(number) * UNITS[unit]


def pod(thing):
    """The pod of an object that has or is one: metadata and spec."""
    if thing["kind"] == "Pod":
        return thing
    return thing.get("spec", {}).get("template")


def named(objects, kind, name):
    return next((it for it in objects if it["kind"] == kind and it["metadata"]["name"] == name), None)


def is_selected(selector, labels):
    return all(labels.get(key) == value for key, value in selector.items())


class Manifests:
    """Objects that are to be applied together, and what is wrong with them."""

    def __init__(self, objects, programs, versions):
        self.objects, self.programs, self.versions = objects, programs, versions
        self.pods = {f"{it['kind']} {it['metadata']['name']}": pod(it) for it in objects if pod(it)}

    def problems(self):
        for thing in self.objects:
            yield from self.schema(thing)
        for what, it in self.pods.items():
            yield from self.restrictions(what, it["spec"])
            yield from self.volumes(what, it["spec"])
            yield from self.probes(what, it["spec"])
            yield from self.arguments(what, it["spec"])
        yield from self.services()
        yield from self.policies()
        yield from self.scaling()
        yield from self.ending()

    def schema(self, thing):
        what = f"{thing['kind']} {thing['metadata']['name']}"
        for version in self.versions:
            try:
                schemas.validate(thing, version, strict=True)
            except (schemas.ValidationError, schemas.SchemaNotFoundError) as error:
                yield f"{what}: Kubernetes {version}: {error.message}"

    def restrictions(self, what, spec):
        """What the profile `restricted` and a read-only root ask for."""
        context = spec.get("securityContext", {})
        expected = {"runAsNonRoot": True, "runAsUser": 65532, "runAsGroup": 65532, "fsGroup": 65532}
        for key, value in expected.items():
            if context.get(key) != value:
                yield f"{what}: {key} must be {value}, got {context.get(key)}"
        if context.get("seccompProfile") != {"type": "RuntimeDefault"}:
            yield f"{what}: seccompProfile must be RuntimeDefault"
        if spec.get("automountServiceAccountToken") is not False:
            yield f"{what}: automountServiceAccountToken must be false"
        for key in ("hostNetwork", "hostPID", "hostIPC"):
            if spec.get(key):
                yield f"{what}: {key} must not be there"
        for container in spec["containers"]:
            closed = {"allowPrivilegeEscalation": False, "readOnlyRootFilesystem": True, "capabilities": {"drop": ["ALL"]}}
            if container.get("securityContext") != closed:
                yield f"{what}: securityContext must be {closed}, got {container.get('securityContext')}"
            if "memory" not in container.get("resources", {}).get("limits", {}):
                yield f"{what}: a limit of memory must be there"

    def volumes(self, what, spec):
        volumes = {volume["name"]: volume for volume in spec.get("volumes", [])}
        mounted = {mount["name"] for container in spec["containers"] for mount in container.get("volumeMounts", [])}
        if mounted != set(volumes):
            yield f"{what}: volumes must be those that are mounted, got {sorted(volumes)} and {sorted(mounted)}"
        for volume in volumes.values():
            for kind, key, field in (("ConfigMap", "configMap", "name"), ("Secret", "secret", "secretName"),
                                     ("PersistentVolumeClaim", "persistentVolumeClaim", "claimName")):
                if key in volume and not named(self.objects, kind, volume[key][field]):
                    yield f"{what}: no {kind} {volume[key][field]}"
            if "emptyDir" in volume and "sizeLimit" not in volume["emptyDir"]:
                yield f"{what}: emptyDir {volume['name']} must have a limit"
            kept = [word.partition("=")[2] for container in spec["containers"] for word in container.get("args", [])
                    if word.startswith("--cache-size=")]
            if "emptyDir" in volume and (not kept or size(kept[0]) >= size(volume["emptyDir"].get("sizeLimit", 0))):
                yield f"{what}: --cache-size must be below the limit of its volume, or kubelet evicts the pod, got {kept}"

    def probes(self, what, spec):
        for container in spec["containers"]:
            ports = {port["name"] for port in container.get("ports", [])}
            probes = [key for key in container if key.endswith("Probe")]
            if "metrics" in ports and sorted(probes) != ["livenessProbe", "readinessProbe", "startupProbe"]:
                yield f"{what}: three probes must be there, got {probes}"
            for key in probes:
                get = container[key]["httpGet"]
                path = "/readyz" if key == "readinessProbe" else "/healthz"
                if get["port"] not in ports or get["path"] != path or get.get("scheme") != "HTTPS":
                    yield f"{what}: {key} must ask for {path} by HTTPS at a port that is there, got {get}"

    def arguments(self, what, spec):
        for container in spec["containers"]:
            program = container["command"][0]
            if program not in ("coordinator", "worker"):
                continue
            # The programs read arguments one after the other: help comes last, when all others have been understood.
            done = run(self.programs / program, *container["args"], "--help", code=None)
            if done.returncode != 0:
                yield f"{what}: arguments are refused: {done.stderr.strip()}"
            bound = {word.rsplit(":", 1)[1] for word in container["args"] if re.match("--(listen|metrics)=", word)}
            ports = {str(port["containerPort"]) for port in container.get("ports", [])}
            if bound != ports:
                yield f"{what}: ports must be those of its arguments, got {sorted(ports)} and {sorted(bound)}"
            version = tomllib.loads((REPOSITORY / "Cargo.toml").read_text())["workspace"]["package"]["version"]
            if container["image"] != f"localhost/descry:{version}":
                yield f"{what}: the image must be that of deploy/image, localhost/descry:{version}, got {container['image']}"

    def matching(self, selector):
        return [it for it in self.pods.values() if is_selected(selector, it["metadata"].get("labels", {}))]

    def has_ports(self, what, selector, ports):
        pods = self.matching(selector)
        if not pods:
            yield f"{what}: selects no pod"
        for it in pods:
            names = {port["name"] for container in it["spec"]["containers"] for port in container.get("ports", [])}
            for port in ports:
                if port not in names:
                    yield f"{what}: no port {port} in the pods that it selects"

    def services(self):
        for thing in self.objects:
            if thing["kind"] == "Service":
                what = f"Service {thing['metadata']['name']}"
                ports = [port["targetPort"] for port in thing["spec"]["ports"]]
                yield from self.has_ports(what, thing["spec"]["selector"], ports)
                for it in self.matching(thing["spec"]["selector"]):
                    numbers = {port["name"]: port["containerPort"] for box in it["spec"]["containers"] for port in box["ports"]}
                    for port in thing["spec"]["ports"]:
                        # Without a cluster address nothing translates one port into another.
                        if numbers.get(port["targetPort"]) != port["port"]:
                            yield f"{what}: port {port['port']} must be that of the pods"
            selector = thing["spec"].get("selector") if thing["kind"] in ("Deployment", "PodDisruptionBudget") else None
            if selector and len(self.matching(selector["matchLabels"])) != 1:
                yield f"{thing['kind']} {thing['metadata']['name']}: must select the pods of one object"

    def policies(self):
        policies = [thing for thing in self.objects if thing["kind"] == "NetworkPolicy"]
        closed = {"podSelector": {}, "policyTypes": ["Ingress", "Egress"]}
        if closed not in [policy["spec"] for policy in policies]:
            yield "NetworkPolicy: one must close everything"
        opened = set()
        for policy in policies:
            what = f"NetworkPolicy {policy['metadata']['name']}"
            chosen = policy["spec"]["podSelector"].get("matchLabels", {})
            if not self.matching(chosen):
                yield f"{what}: selects no pod"
            for direction, side in (("ingress", "from"), ("egress", "to")):
                for rule in policy["spec"].get(direction, []):
                    if not rule.get(side) or not rule.get("ports"):
                        yield f"{what}: a rule must name whom and which ports"
                        continue
                    ports = [port["port"] for port in rule["ports"]]
                    for peer in rule[side]:
                        if "namespaceSelector" in peer:
                            other = "/".join(peer["namespaceSelector"]["matchLabels"].values())
                        else:
                            labels = peer["podSelector"]["matchLabels"]
                            if not self.matching(labels):
                                yield f"{what}: {direction} names pods that are not there"
                            other = labels.get(COMPONENT)
                        aim = chosen if direction == "ingress" else peer.get("podSelector", {}).get("matchLabels", {})
                        if direction == "ingress" or "namespaceSelector" not in peer:
                            yield from self.has_ports(what, aim, ports)
                        opened |= {(chosen.get(COMPONENT), direction, other, port) for port in ports}
        expected = {("coordinator", "ingress", "worker", "workers"), ("coordinator", "ingress", "monitoring", "metrics"),
                    ("worker", "egress", "coordinator", "workers"), ("worker", "egress", "kube-system", 53)}
        if opened != expected:
            yield f"NetworkPolicy: what is open must be {sorted(map(str, expected))}, got {sorted(map(str, opened))}"

    def scaling(self):
        for thing in self.objects:
            if thing["kind"] != "HorizontalPodAutoscaler":
                continue
            what = f"HorizontalPodAutoscaler {thing['metadata']['name']}"
            target = named(self.objects, thing["spec"]["scaleTargetRef"]["kind"], thing["spec"]["scaleTargetRef"]["name"])
            if not target:
                yield f"{what}: scales nothing that is there"
                continue
            if "replicas" in target["spec"]:
                yield f"{what}: each `kubectl apply` would set replicas again"
            [container] = target["spec"]["template"]["spec"]["containers"]
            [threads] = [word.partition("=")[2] for word in container["args"] if word.startswith("--threads=")]
            external = thing["spec"]["metrics"][0]["external"]
            found = {threads, container["resources"]["requests"]["cpu"], external["target"].get("averageValue")}
            if len(found) != 1:
                yield f"{what}: threads, cpu and average must be equal, got {sorted(map(str, found))}"
            page = (REPOSITORY / "docs/src/reference/metrics.md").read_text()
            rule = (SOURCE / "prometheus-adapter.yaml").read_text()
            if f"`{external['metric']['name']}`" not in page or external["metric"]["name"] not in rule:
                yield f"{what}: no metric {external['metric']['name']}"

    def ending(self):
        """Codes that starting again does not mend are those of the services of systemd, and that of `control stop`."""
        job = named(self.objects, "Job", "descry-coordinator")
        unit = (REPOSITORY / "deploy/systemd/descry-coordinator@.service").read_text()
        codes = [int(code) for code in re.search("^RestartPreventExitStatus=(.*)$", unit, re.MULTILINE)[1].split()] + [130]
        rules = job["spec"]["podFailurePolicy"]["rules"]
        ends = [rule["onExitCodes"]["values"] for rule in rules if rule["action"] == "FailJob"]
        if ends != [codes]:
            yield f"Job descry-coordinator: must fail with {codes}, got {ends}"


def breaks(objects):
    """How to break a copy of the objects, and what must be said of it."""
    def of(it, kind, name):
        return named(it, kind, name)["spec"]

    def container(it, kind, name):
        return pod(named(it, kind, name))["spec"]["containers"][0]

    job, worker = ("Job", "descry-coordinator"), ("Deployment", "descry-worker")
    labels = lambda it, key: pod(named(it, *key))["metadata"]["labels"]  # noqa: E731
    return [
        ("a field that no schema has", lambda it: of(it, *worker).update(replica=3), "replica"),
        ("a kind of value that no schema has", lambda it: of(it, *job).update(backoffLimit="ten"), "Kubernetes"),
        ("a field that is missing", lambda it: of(it, *worker).pop("selector"), "selector"),
        ("a version of an API that is gone", lambda it: named(it, "PodDisruptionBudget", "descry-worker").update(
            apiVersion="policy/v1beta1"), "schema"),
        ("labels that no selector matches", lambda it: labels(it, job).update({COMPONENT: "other"}), "selects no pod"),
        ("a port of no service", lambda it: container(it, *job)["ports"][0].update(name="other"), "no port workers"),
        ("a service at another port", lambda it: of(it, "Service", "descry-coordinator")["ports"][0].update(port=7701),
         "that of the pods"),
        ("a probe of another path", lambda it: container(it, *job)["readinessProbe"]["httpGet"].update(path="/ready"), "/readyz"),
        ("a probe of no port", lambda it: container(it, *job)["livenessProbe"]["httpGet"].update(port="web"), "livenessProbe"),
        ("an option that is not there", lambda it: container(it, *worker)["args"].append("--stays"), "--stays"),
        ("a value that is refused", lambda it: container(it, *worker)["args"].append("--lifetime=long"), "--lifetime"),
        ("another port in the arguments", lambda it: container(it, *job)["args"].append("--listen=0.0.0.0:7701"), "ports must"),
        ("root", lambda it: pod(named(it, *worker))["spec"]["securityContext"].update(runAsUser=0), "runAsUser"),
        ("a root that can be written", lambda it: container(it, *worker)["securityContext"].update(readOnlyRootFilesystem=False),
         "readOnlyRootFilesystem"),
        ("a capability", lambda it: container(it, *job)["securityContext"]["capabilities"].update(add=["NET_ADMIN"]),
         "NET_ADMIN"),
        ("a token of the cluster", lambda it: pod(named(it, *job))["spec"].pop("automountServiceAccountToken"),
         "automountServiceAccountToken"),
        ("a secret that is not there", lambda it: it.remove(named(it, "Secret", "descry-join")), "no Secret descry-join"),
        ("a volume without a mount", lambda it: container(it, *job)["volumeMounts"].pop(), "volumes must"),
        ("a cache without a limit", lambda it: pod(named(it, *worker))["spec"]["volumes"][1]["emptyDir"].clear(), "limit"),
        ("a cache over its limit", lambda it: pod(named(it, *worker))["spec"]["volumes"][1]["emptyDir"].update(sizeLimit="1Gi"),
         "--cache-size"),
        ("an open network", lambda it: of(it, "NetworkPolicy", "descry-worker")["egress"].append({}), "whom and which"),
        ("a policy for no pod", lambda it: of(it, "NetworkPolicy", "descry-worker")["podSelector"]["matchLabels"].update(
            {COMPONENT: "workers"}), "NetworkPolicy descry-worker: selects no pod"),
        ("nothing closed", lambda it: it.remove(named(it, "NetworkPolicy", "descry-nothing")), "close everything"),
        ("threads that differ", lambda it: of(it, "HorizontalPodAutoscaler", "descry-worker")["metrics"][0]["external"][
            "target"].update(averageValue="8"), "must be equal"),
        ("a metric that is not there", lambda it: of(it, "HorizontalPodAutoscaler", "descry-worker")["metrics"][0][
            "external"]["metric"].update(name="descry_threads"), "no metric"),
        ("another object to scale", lambda it: of(it, "HorizontalPodAutoscaler", "descry-worker")["scaleTargetRef"].update(
            name="worker"), "scales nothing"),
        ("replicas", lambda it: of(it, *worker).update(replicas=3), "set replicas again"),
        ("another image", lambda it: container(it, *job).update(image="descry:latest"), "image must"),
        ("a code that is tried again", lambda it: of(it, *job)["podFailurePolicy"]["rules"][2]["onExitCodes"]["values"].remove(4),
         "must fail with"),
    ]


def certificates(folder, programs):
    """As the page says it."""
    run(programs / "coordinator", "certs", folder / "tls", "--host", "descry-coordinator")
    for name in ("dashboard-view", "dashboard-control"):
        (folder / "tls" / name).write_text(run("openssl", "rand", "-hex", "32").stdout)


def check(folder, programs):
    certificates(folder, programs)
    objects = build(folder)
    versions = schemas.all_versions()
    versions = versions[versions.index(OLDEST):]
    found = list(Manifests(objects, programs, versions).problems())
    if found:
        raise SystemExit("\n".join(found))
    kinds = ", ".join(f"{it['kind']} {it['metadata']['name']}" for it in objects)
    say(f"{len(objects)} objects, Kubernetes {versions[0]} to {versions[-1]}: {kinds}")
    ends = [versions[0], versions[-1]]
    for what, change, part in breaks(objects):
        broken = copy.deepcopy(objects)
        change(broken)
        found = list(Manifests(broken, programs, ends).problems())
        if not any(part in problem for problem in found):
            raise SystemExit(f"{what}: must be found, with {part!r}, got {found}")
    say(f"{len(breaks(objects))} ways to break them: all found")
    for name in ("worker.yaml", "experiment.toml", "tls/join"):
        (folder / name).rename(folder / "away")
        if run("kubectl", "kustomize", folder, code=None).returncode == 0:
            raise SystemExit(f"kubectl kustomize: must fail without {name}")
        (folder / "away").rename(folder / name)
    say("kubectl kustomize fails without a file that it names")
    return objects


def prometheus(folder):
    """The configuration of Prometheus, and the query that prometheus-adapter makes of its rule."""
    run("promtool", "check", "config", "--syntax-only", folder / "prometheus.yml")
    [scrape] = yaml.safe_load((folder / "prometheus.yml").read_text())["scrape_configs"]
    labels = scrape["static_configs"][0]["labels"]
    assert labels == {"namespace": "descry"}, labels
    [rule] = yaml.safe_load((folder / "prometheus-adapter.yaml").read_text())["externalRules"]
    query = rule["metricsQuery"].replace("<<.Series>>", "descry_wanted_threads")
    query = query.replace("<<.LabelMatchers>>", 'namespace="descry"')
    assert "<<" not in query, query
    series = 'descry_wanted_threads{namespace="descry",instance="a"}'
    values = lambda text: [{"series": series, "values": text}]  # noqa: E731
    expect = lambda at, value: {"expr": query, "eval_time": at, "exp_samples": [{"value": value}]}  # noqa: E731
    tests = [
        # Seven are wanted, none for a moment, then the run has ended.
        {"interval": "1m", "input_series": values("7 7 0 7 stale"),
         "promql_expr_test": [expect("2m", 7), expect("7m", 7), expect("9m", 0), expect("30m", 0)]},
        {"interval": "1m", "input_series": [{"series": 'descry_wanted_threads{namespace="other"}', "values": "5 5"}],
         "promql_expr_test": [expect("1m", 0)]},
    ]
    file = folder / "adapter_test.yml"
    file.write_text(yaml.safe_dump({"tests": tests}))
    run("promtool", "test", "rules", file)
    tests[0]["promql_expr_test"][0]["exp_samples"][0]["value"] = 6
    file.write_text(yaml.safe_dump({"tests": tests}))
    run("promtool", "test", "rules", file, code=1)
    file.unlink()
    say(f"{query}: what is wanted, and 0 when the run has ended")


class Network:
    """A network namespace with an address that is not loopback."""

    def __enter__(self):
        up = f"ip link set lo up && ip address add {ADDRESS}/32 dev lo && exec sleep 3600"
        self.process = subprocess.Popen(["unshare", "--net", "sh", "-c", up])
        self.enter = ["nsenter", f"--net=/proc/{self.process.pid}/ns/net"]
        is_up = lambda: ADDRESS in run(*self.enter, "ip", "address", code=None).stdout  # noqa: E731
        waiting.wait("address", is_up, PATIENCE)
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()

    def get(self, url, *more):
        """Status and body."""
        done = run(*self.enter, "curl", "--silent", "--insecure", "--noproxy", "*", "--write-out", "\n%{http_code}", *more, url,
                   code=None)
        body, _, status = done.stdout.rpartition("\n")
        return int(status or 0), body


class Pod:
    """One container, as kubelet and a runtime would start it, but for control groups and seccomp."""

    def __init__(self, objects, thing, programs, folder):
        self.spec = pod(thing)["spec"]
        [self.container] = self.spec["containers"]
        self.root, self.kept = folder / "root", folder / "volumes"
        self.user = self.spec["securityContext"]["runAsUser"]
        self.group = self.spec["securityContext"]["fsGroup"]
        for name in ("usr", "programs", "proc", "dev", "etc"):
            (self.root / name).mkdir(parents=True)
        for name in ("bin", "lib", "lib64"):
            (self.root / name).symlink_to(f"usr/{name}")
        (self.root / "etc/hosts").write_text(f"{ADDRESS} descry-coordinator\n")
        self.mounts = [f"mount --rbind /{name} {self.root}/{name}" for name in ("usr", "proc", "dev")]
        self.mounts.append(f"mount --bind {programs} {self.root}/programs")
        volumes = {volume["name"]: volume for volume in self.spec["volumes"]}
        for mount in self.container["volumeMounts"]:
            source = self.volume(objects, volumes[mount["name"]])
            place = f"{self.root}{mount['mountPath']}"
            # The places are there before the root is read only, as a runtime makes them.
            pathlib.Path(place).mkdir(parents=True, exist_ok=True)
            self.mounts.append(f"mount --bind {source} {place}")
            if mount.get("readOnly"):
                self.mounts.append(f"mount -o remount,bind,ro {place}")

    def volume(self, objects, volume):
        folder = self.kept / volume["name"]
        folder.mkdir(parents=True)
        os.chown(folder, 0, self.group)
        folder.chmod(0o2775)
        for kind, key, field in (("ConfigMap", "configMap", "name"), ("Secret", "secret", "secretName")):
            if key in volume:
                # Files are links into a folder that is exchanged as a whole.
                data = folder / "..2026_01_01"
                data.mkdir()
                (folder / "..data").symlink_to(data.name)
                it = named(objects, kind, volume[key][field])
                for name in it["data"]:
                    file = data / name
                    file.write_bytes(self.content(it, name))
                    file.chmod(volume[key].get("defaultMode", 0o644))
                    os.chown(file, 0, self.group)
                    (folder / name).symlink_to(f"..data/{name}")
        return folder

    @staticmethod
    def content(it, name):
        return it["data"][name].encode() if it["kind"] == "ConfigMap" else base64.b64decode(it["data"][name])

    def start(self, network, log):
        words = [*self.container["command"], *self.container["args"]]
        variables = " ".join(f"{key}={value}" for key, value in {**ENVIRONMENT, "PATH": "/programs:/usr/bin"}.items())
        limits = f"--reuid={self.user} --regid={self.group} --clear-groups --bounding-set=-all --inh-caps=-all --no-new-privs"
        inside = f"cd /data 2>/dev/null || cd /; exec setpriv {limits} {' '.join(words)}"
        # The mounts below the root are made on what stays read only.
        steps = [f"mount --rbind {self.root} {self.root}", f"cd {self.root}", *self.mounts,
                 f"mount -o remount,bind,ro {self.root}",
                 f"exec chroot {self.root} env --ignore-environment {variables} sh -c '{inside}'"]
        command = [*network.enter, "unshare", "--mount", "nice", "-n", "19", "sh", "-e", "-c", "\n".join(steps)]
        with open(log, "w") as out:
            return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=out, stderr=out)


def demo(objects, programs, folder):
    """The run that the manifests begin, and what happens when the coordinator is started again."""
    coordinator = Pod(objects, named(objects, "Job", "descry-coordinator"), programs, folder / "coordinator")
    worker = Pod(objects, named(objects, "Deployment", "descry-worker"), programs, folder / "worker")
    log = folder / "coordinator.log"
    metrics = f"https://{ADDRESS}:7790"
    tls = coordinator.kept / "tls"
    token = ["--header", f"Authorization: Bearer {(tls / 'dashboard-view').read_text().strip()}"]
    started = []
    with Network() as network:
        try:
            started.append(coordinator.start(network, log))
            ready = lambda: started[0].poll() is not None or network.get(f"{metrics}/readyz")[0] == 200  # noqa: E731
            waiting.wait("readyz", ready, PATIENCE)
            if started[0].poll() is not None:
                raise SystemExit(f"coordinator: has ended with {started[0].returncode}\n{log.read_text()}")
            answers = {path: network.get(f"{metrics}{path}")[0] for path in ("/healthz", "/readyz", "/metrics")}
            assert answers == {"/healthz": 200, "/readyz": 200, "/metrics": 401}, answers
            # As prometheus.yml has it: the certificate must be that of the name.
            named_url = "https://descry-coordinator:7790/metrics"
            status, body = network.get(named_url, *token, "--no-insecure", "--cacert", tls / "ca.pem", "--resolve",
                                       f"descry-coordinator:7790:{ADDRESS}")
            assert status == 200 and re.search(r"^descry_wanted_threads 1(\.0)?$", body, re.MULTILINE), (status, body[:500])
            say("probes: 200; metrics: 401 without the token, with it wanted threads")
            started.append(worker.start(network, folder / "worker.log"))
            code = started[0].wait(PATIENCE)
            assert code == 0 and DEMO in log.read_text(), f"coordinator: {code}\n{log.read_text()}"
            say("the demo by coordinator and worker as the manifests start them: digest as expected")
            assert started[1].poll() is None, (folder / "worker.log").read_text()
            again = coordinator.start(network, log)
            started.append(again)
            assert again.wait(PATIENCE) == 0 and "this run is finished" in log.read_text(), log.read_text()
            say("started again: shows the finished run and ends with 0")
            started[1].terminate()
            assert started[1].wait(PATIENCE) == 0, (folder / "worker.log").read_text()
            say("the worker has waited for another run, and ends with 0 when it is told to")
        finally:
            for process in started:
                process.kill()
                process.wait()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("programs", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    arguments = parser.parse_args()
    programs, out = arguments.programs.resolve(), arguments.out.resolve()
    for program in ("kubectl", "promtool", "openssl", "curl", "unshare", "setpriv"):
        if not shutil.which(program):
            sys.exit(f"{program}: must be there, got nothing\ninstall it")
    for name in ("manifests", "pods"):
        shutil.rmtree(out / name, ignore_errors=True)
    folder = out / "manifests"
    shutil.copytree(SOURCE, folder, ignore=shutil.ignore_patterns("tls"))
    objects = check(folder, programs)
    prometheus(folder)
    demo(objects, programs, out / "pods")


if __name__ == "__main__":
    main()
