"""Flash of two slots in Python, behind the C library's functions."""

from typing import Any

from control_library import ControlLibrary

SLOT = 16384


class Flash:
    """Two erased slots, and a C config that reaches them."""

    def __init__(self, c: ControlLibrary, motor: int = 0, motion: int = 0, write_size: int = 8) -> None:
        self.slot = [bytearray(b"\xff" * SLOT) for _ in range(2)]
        ffi = c.ffi

        def erase(context: Any, slot: int) -> int:
            self.slot[slot][:] = b"\xff" * SLOT
            return 0

        def write(context: Any, slot: int, offset: int, source: Any, count: int) -> int:
            assert offset % write_size == count % write_size == 0
            assert self.slot[slot][offset : offset + count] == b"\xff" * count
            self.slot[slot][offset : offset + count] = ffi.buffer(source, count)
            return 0

        def read(context: Any, slot: int, offset: int, target: Any, count: int) -> int:
            ffi.memmove(target, bytes(self.slot[slot][offset : offset + count]), count)
            return 0

        place = "cgl_flash_result(void *, uint32_t, uint32_t, uint8_t *, uint32_t)"
        self._kept = (
            ffi.callback("cgl_flash_result(void *, uint32_t)", erase),
            ffi.callback(place.replace("uint8_t", "const uint8_t"), write),
            ffi.callback(place, read),
            ffi.new("uint8_t[]", max(64, write_size)),
        )
        erase_c, write_c, read_c, buffer = self._kept
        self.config = c.new(
            "cgl_map_store_config",
            erase=erase_c,
            write=write_c,
            read=read_c,
            slot_size=SLOT,
            write_size=write_size,
            motor=motor,
            motion=motion,
        )
        self.store = c.new("cgl_map_store")
        assert c.lib.cgl_map_store_init(self.store, self.config, buffer, len(buffer)) == 0
        self._c = c

    def save(self, stored: Any) -> int:
        """Save a cgl_map in the flash; returns a cgl_map_result."""
        lib = self._c.lib
        result = lib.cgl_map_store_begin(self.store, stored)
        while result == lib.CGL_MAP_OK or result == lib.CGL_MAP_BUSY:
            result = lib.cgl_map_store_step(self.store)
            if result != lib.CGL_MAP_BUSY:
                break
        return int(result)

    def load(self, stored: Any) -> int:
        """Load a cgl_map from the flash; returns a cgl_map_result."""
        return int(self._c.lib.cgl_map_store_load(self.store, stored))
