"""The Kubernetes manifests, as kubectl puts them together and as their schemas have them."""

import shutil
import subprocess
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml

Resource = dict[str, Any]

CHANNELS = 4
SERVICES = [
    "featurizer",
    "describer",
    "fuser",
    "verifier",
    *(f"channel-{channel}" for channel in range(CHANNELS)),
]


@pytest.fixture(scope="module")
def resources(deploy: Path) -> list[Resource]:
    if shutil.which("kubectl") is None:
        pytest.skip("needs the command 'kubectl'")
    built = subprocess.run(
        ["kubectl", "kustomize", deploy / "kubernetes"], capture_output=True, text=True, check=True
    )
    return list(yaml.safe_load_all(built.stdout))


def deployments(resources: list[Resource]) -> dict[str, Resource]:
    return {r["metadata"]["name"]: r["spec"] for r in resources if r["kind"] == "Deployment"}


def containers(resources: list[Resource]) -> Iterator[tuple[str, Resource]]:
    for name, deployment in deployments(resources).items():
        for container in deployment["template"]["spec"]["containers"]:
            yield name, container


def test_every_resource_is_one_by_its_schema(resources: list[Resource]) -> None:
    for resource in resources:
        kubernetes_validate.validate(resource, kubernetes_validate.latest_version(), strict=True)


def test_there_is_a_deployment_per_service_and_one_per_channel(resources: list[Resource]) -> None:
    found = deployments(resources)
    assert set(found) == {"router", *SERVICES}
    for channel in range(CHANNELS):
        deployment = found[f"channel-{channel}"]
        (container,) = deployment["template"]["spec"]["containers"]
        assert {"name": "CHANNEL", "value": str(channel)} in container["env"]
        assert deployment["selector"]["matchLabels"]["placefield/channel"] == str(channel)


def test_selectors_select_their_own_pods_alone(resources: list[Resource]) -> None:
    found = deployments(resources)
    for name, deployment in found.items():
        wanted = deployment["selector"]["matchLabels"].items()
        selected = [
            other
            for other in found
            if wanted <= found[other]["template"]["metadata"]["labels"].items()
        ]
        assert selected == [name]


def test_no_pod_has_a_right_that_it_does_not_need(resources: list[Resource]) -> None:
    for deployment in deployments(resources).values():
        pod = deployment["template"]["spec"]
        assert pod["automountServiceAccountToken"] is False
        assert pod["securityContext"]["runAsNonRoot"] is True
        assert pod["securityContext"]["runAsUser"] > 0
        assert pod["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}
        for volume in pod["volumes"]:
            assert volume.get("persistentVolumeClaim", {"readOnly": True})["readOnly"]
    for _, container in containers(resources):
        own = container["securityContext"]
        assert own["allowPrivilegeEscalation"] is False
        assert own["readOnlyRootFilesystem"] is True
        assert own["capabilities"] == {"drop": ["ALL"]}
        assert {"cpu", "memory"} == set(container["resources"]["limits"])
        assert {"cpu", "memory"} == set(container["resources"]["requests"])


def test_services_are_probed_by_their_tokens(resources: list[Resource]) -> None:
    for name, container in containers(resources):
        if name == "router":
            continue
        command = " ".join(container["livenessProbe"]["exec"]["command"])
        assert f"placefield alive {name.partition('-')[0]}" in command
        assert container["startupProbe"]["exec"] == container["livenessProbe"]["exec"]


def test_images_are_pinned_and_the_stock_router_is_of_the_version_that_services_have(
    resources: list[Resource], deploy: Path
) -> None:
    project = tomllib.loads((deploy.parent / "pyproject.toml").read_text())["project"]
    images = {name: container["image"] for name, container in containers(resources)}
    for name in SERVICES:
        role = name.partition("-")[0]
        assert images[name] == f"placefield-{role}:{project['version']}"
    pins = (deploy / "docker" / "router.txt").read_text().splitlines()
    version = images["router"].removeprefix("eclipse/zenoh:")
    assert f"eclipse-zenoh=={version}" in pins


def test_nobody_but_pods_of_placefield_reaches_the_router_and_nobody_reaches_them(
    resources: list[Resource],
) -> None:
    policies = {r["metadata"]["name"]: r["spec"] for r in resources if r["kind"] == "NetworkPolicy"}
    assert policies["nobody"] == {"podSelector": {}, "policyTypes": ["Ingress", "Egress"]}
    incoming = {name: policy for name, policy in policies.items() if "ingress" in policy}
    assert set(incoming) == {"router"}
    (rule,) = incoming["router"]["ingress"]
    part_of = {"app.kubernetes.io/part-of": "placefield"}
    assert rule["from"] == [{"podSelector": {"matchLabels": part_of}}]
    for deployment in deployments(resources).values():
        assert part_of.items() <= deployment["template"]["metadata"]["labels"].items()
