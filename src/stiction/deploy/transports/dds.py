"""Unitree's two topics over DDS, as bytes: `rt/lowstate` comes, `rt/lowcmd` goes. Needs the extra `unitree`.

Cyclone DDS does discovery and transport; `files.unitree` knows the content of messages. Its own way of turning them
into Python objects is too slow for a state of 35 motors, of which 500 come a second; so bytes go through as they are.
"""

from __future__ import annotations

import socket
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from types import new_class
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from stiction.core.errors import ConfigurationError, RobotError
from stiction.core.extras import remedy
from stiction.deploy.transports.link import Bell, Peers
from stiction.files.unitree import Structure

STATE_TOPIC, COMMAND_TOPIC = "rt/lowstate", "rt/lowcmd"

MOST_DOMAIN = 232
"""Largest number of a DDS domain: beyond it there are no ports."""

MOST_WAITING = 64
"""States that may wait: an eighth of a second at 500 Hz. More are lost, the oldest first."""

WAKE_MS = 100
"""Time between the watching thread's checks for its end [ms]."""

PEERS_SECONDS = 0.01
"""Time between queries of Cyclone for peers [s]; one costs 50 µs."""

MOST_PARTICIPANTS = 256
"""Most programs of a domain that are searched for a name."""

HANDLE = 2**64 - 1
"""Mask of a handle: some of Cyclone's functions return it with a sign, some without."""


def domain_settings(interface: str) -> str:
    """Return Cyclone's settings for one interface; on loopback without multicast, which it often lacks."""
    general, alone = f"<Interfaces><NetworkInterface name={quoteattr(interface)}/></Interfaces>", ""
    if interface == "lo":
        # Without multicast participants are looked for one by one, at ports that follow from their index.
        general += "<AllowMulticast>false</AllowMulticast>"
        peers = '<ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers>'
        alone = f"<Discovery>{peers}</Discovery>"
    return f'<CycloneDDS><Domain Id="any"><General>{general}</General>{alone}</Domain></CycloneDDS>'


class DdsBus:
    """Bus with the two topics of one robot over Cyclone DDS on one network interface; sending never waits.

    The writer of the first state is pinned: states of any other are not used, but counted.
    """

    def __init__(self, interface: str, state: Structure, command: Structure, domain: int = 0) -> None:
        """Join a domain; nothing is sent.

        Raises `ConfigurationError`: no such interface or domain; `RobotError`: cyclonedds is missing, or cannot use
        it.
        """
        if interface not in (interfaces := [known for _, known in socket.if_nameindex()]):
            raise ConfigurationError(
                f"no network interface {interface!r} on this machine; it has {', '.join(interfaces)}: name the one "
                "with the robot's cable"
            )
        if not 0 <= domain <= MOST_DOMAIN:
            raise ConfigurationError(f"--domain: got {domain}, expected 0 to {MOST_DOMAIN}; choose the robot's own")
        dds = _cyclone()
        try:
            # Settings that are given so are the only ones: an environment variable that names others does nothing.
            self._domain = dds.domain.Domain(domain, domain_settings(interface))
            participant = dds.domain.DomainParticipant(domain)
            states = dds.topic.Topic(participant, STATE_TOPIC, wire_type(state))
            commands = dds.topic.Topic(participant, COMMAND_TOPIC, wire_type(command))
            policy = dds.qos.Policy
            # A state that was lost is not wanted any more; a robot that wants commands reliably gets them so. Without
            # IgnoreLocal our own commands would be heard as another writer's.
            fresh = (policy.Reliability.BestEffort, policy.IgnoreLocal.Participant)
            reader_qos = dds.qos.Qos(*fresh, policy.History.KeepLast(MOST_WAITING))
            # With 0 ns, to write never waits for a slow reader: it fails, and the command is lost.
            writer_qos = dds.qos.Qos(policy.Reliability.Reliable(0), policy.History.KeepLast(1))
            self._states = dds.sub.DataReader(participant, states, reader_qos)
            self._commands = dds.sub.DataReader(participant, commands, dds.qos.Qos(*fresh, policy.History.KeepLast(1)))
            self._writer = dds.pub.DataWriter(participant, commands, writer_qos)
            everybody = dds.builtin.BuiltinTopicDcpsParticipant
            self._participants = dds.builtin.BuiltinDataReader(participant, everybody)
            come = dds.core.ReadCondition(
                self._states, dds.core.SampleState.NotRead | dds.core.ViewState.Any | dds.core.InstanceState.Any
            )
            self._waits = dds.core.WaitSet(participant)
            self._waits.attach(come)
        except dds.core.DDSException as error:
            raise RobotError(f"DDS cannot use the network interface {interface!r}: {error}") from error
        self.writer, self._known = str(participant.guid), set[str]()
        """Identifier of this program in the domain."""
        self._error, self._wire = dds.core.DDSException, wire_type(command)
        self._entities: list[Any] = [come, self._writer, self._commands, self._states, self._participants]
        self._entities += [states, commands, participant]
        self._pinned, self._lost, self._writers = 0, 0, dict[int, str]()
        self._peers, self._asked, self._counts = Peers(), -PEERS_SECONDS, (-1, -1)
        self._bell, self._heard, self._closed = Bell(), threading.Event(), False
        self._watcher = threading.Thread(target=self._watch, daemon=True, name="rt/lowstate")
        self._watcher.start()

    def _watch(self) -> None:
        """Make the file readable whenever states have come; a thread of its own, since DDS has no file to wait for."""
        while not self._closed:
            if self._waits.wait(WAKE_MS * 1_000_000) and not self._closed:
                self._bell.ring()
                # The condition holds until the states are taken: without waiting for that, this thread would spin.
                self._heard.wait(WAKE_MS / 1e3)
                self._heard.clear()

    def fileno(self) -> int:
        """Return the file that the watching thread makes readable."""
        return self._bell.fileno()

    def receive(self) -> list[tuple[int, bytes]]:
        """Return the new states, oldest first, each with its writer's time [ns]; never waits."""
        # First: what comes from here on rings again.
        self._bell.silence()
        samples = self._states.take(MOST_WAITING)
        self._heard.set()
        came = []
        for sample in samples:
            if not hasattr(sample, "data"):
                continue  # A writer that leaves gives samples without data.
            writer = sample.sample_info.publication_handle & HANDLE
            self._pinned = self._pinned or writer
            if writer == self._pinned:
                came.append((sample.sample_info.source_timestamp, sample.data))
            if writer not in self._writers:
                self._asked = -PEERS_SECONDS  # A new one: to be named at once, and kept though it may leave.
                self._writers[writer] = f"writer {writer:x}"
        return came

    def lost(self) -> int:
        """Return the number of states lost on the way since the last call, as DDS counts them."""
        before, self._lost = self._lost, self._states.get_sample_lost_status().total_count
        return self._lost - before

    def foreign(self) -> bool:
        """Return True if another participant has sent a command since the last call; those of `know` do not count."""
        sent = [sample.sample_info for sample in self._commands.take(1) if hasattr(sample, "data")]
        return bool(sent) and sent[0].publication_handle & HANDLE not in self._known_writers()

    def know(self, writer: str) -> None:
        """Count a participant as ours: its commands and readers are not foreign; writer: its `writer`."""
        self._known.add(writer)
        self._asked, self._counts = -PEERS_SECONDS, (-1, -1)

    def _known_writers(self) -> set[int]:
        """Return the handles of the known participants' writers of commands."""
        handles = self._commands.get_matched_publications() if self._known else ()
        data = ((handle & HANDLE, self._commands.get_matched_publication_data(handle)) for handle in handles)
        return {
            handle
            for handle, publication in data
            if publication is not None and str(publication.participant_key) in self._known
        }

    def peers(self) -> Peers:
        """Return every writer of states that was heard or announced, and the readers of commands."""
        if (now := time.monotonic()) - self._asked < PEERS_SECONDS:
            return self._peers
        self._asked = now
        counts = (
            self._states.get_subscription_matched_status().total_count + len(self._writers),
            self._writer.get_publication_matched_status().current_count,
        )
        if counts == self._counts:
            return self._peers
        self._counts = counts
        names = {str(known.key): _program(known) for known in self._participants.read(MOST_PARTICIPANTS)}
        for handle in self._states.get_matched_publications():
            if (writer := self._states.get_matched_publication_data(handle)) is not None:
                self._writers[handle & HANDLE] = names.get(str(writer.participant_key), str(writer.participant_key))
        readers = map(self._writer.get_matched_subscription_data, self._writer.get_matched_subscriptions())
        read_by = [str(reader.participant_key) for reader in readers if reader is not None]
        read_by = [key for key in read_by if key not in self._known]
        # The pinned one first; before any state has come, in the order of their announcement.
        robots = sorted(self._writers, key=lambda handle: handle != self._pinned)
        self._peers = Peers(
            tuple(self._writers[handle] for handle in robots), tuple(names.get(key, key) for key in read_by)
        )
        return self._peers

    def send(self, data: bytes) -> None:
        """Send a command; what cannot be sent at once is lost."""
        with suppress(self._error):
            self._writer.write(self._wire(data))

    def close(self) -> None:
        """Leave the domain."""
        self._closed = True
        self._heard.set()
        self._watcher.join()
        self._bell.close()
        del self._waits, self._states, self._commands, self._writer, self._participants
        while self._entities:
            self._entities.pop(0)  # Cyclone deletes an entity with its last reference, and parts before their whole
        del self._domain


def _cyclone() -> Any:
    """Return cyclonedds with the modules that are used of it; raise `RobotError` where it is not installed."""
    try:
        import cyclonedds.builtin
        import cyclonedds.core
        import cyclonedds.domain
        import cyclonedds.pub
        import cyclonedds.qos
        import cyclonedds.sub
        import cyclonedds.topic
    except ImportError as error:
        raise RobotError(f"cyclonedds is not installed ({error}); {remedy('unitree')}") from error
    return cyclonedds


def _program(participant: Any) -> str:
    """Return a participant's program, process and machine, as it announces them; else its identifier."""
    properties = {getattr(part, "key", ""): getattr(part, "value", "") for part in participant.qos}
    if "__ProcessName" not in properties:
        return str(participant.key)
    where = f"{properties.get('__Hostname', '?')}, {properties.get('__NetworkAddresses', '?')}"
    return f"{properties['__ProcessName']} (process {properties.get('__Pid', '?')} on {where})"


@cache
def wire_type(structure: Structure) -> type:
    """Return the type of a message as Cyclone DDS has it, whose objects hold the message's bytes, `data`, alone."""
    return _idl_type(structure, structure.name, structure.dtype, raw=True)


def _idl_type(structure: Structure, name: str, layout: np.dtype, raw: bool = False) -> type:
    """Return the type that a structure has in the maker's definitions, or `raw`, where fields are bytes.

    8-bit numbers are `octet`, signed or not, as in the definitions. Cyclone tells types apart by a hash of their
    definition; a robot that is told another hash asks for the definition, and version 0.10.2, which robots have, does
    not survive the answer of version 11.
    """
    from cyclonedds.idl import IdlStruct, annotations, types

    numbers = {"f4": types.float32, "u1": types.byte, "i1": types.byte, "u2": types.uint16, "i2": types.int16}
    numbers |= {"u4": types.uint32, "i4": types.int32}
    hints: dict[str, Any] = {}
    for field in layout.names or ():
        part = layout[field]
        single, shape = part.subdtype or (part, ())
        if field in structure.parts:
            hint = _idl_type(structure, structure.parts[field], single)
        else:
            hint = numbers[single.str[1:]]
        hints[field] = types.array[hint, shape[0]] if shape else hint
    body: dict[str, Any] = {"__annotations__": hints} | (_RAW if raw else {})
    typename = f"{structure.family}.msg.dds_.{name}_"
    message = new_class(f"{name}_", (IdlStruct,), {"typename": typename}, lambda space: space.update(body))
    # Extensibility and ids of members are part of what Cyclone hashes.
    return annotations.final(annotations.autoid("sequential")(dataclass(init=not raw, eq=False, repr=False)(message)))


def _hold(self: Any, data: bytes) -> None:
    self.data = data


_RAW = {
    "__init__": _hold,
    "serialize": lambda self, **_: self.data,
    "deserialize": classmethod(lambda cls, data, **_: cls(bytes(data))),
    "deserialize_key": classmethod(lambda cls, data, **_: None),
}
