defmodule BB.Firmware.TrialTest do
  @moduledoc "Starts of a machine: each firmware is a board of its own, and the folder survives."

  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import ExUnit.CaptureLog

  alias BB.Firmware.Board.Memory
  alias BB.Firmware.Trial.Findings
  alias BB.Firmware.{Story, Trial}

  @moduletag :tmp_dir
  @moduletag :capture_log

  defp firmware(uuid, slot, status) do
    {:ok, memory} =
      Memory.start_link(
        status: status,
        slot: slot,
        tell: self(),
        firmware: %{"nerves_fw_uuid" => uuid, "nerves_fw_version" => "#{uuid}.0"}
      )

    {Memory, memory}
  end

  defp update(folder, old) do
    :ok = Trial.accepted(folder, old, "boot 1")
    :ok = Trial.written(folder)
  end

  test "a revert that nobody told of leaves a story, and closes the slot", %{tmp_dir: folder} do
    old = firmware("old", "a", :validated)
    new = firmware("new", "b", :unvalidated)
    assert Trial.begin(folder, old, "boot 1") == :ok
    update(folder, old)

    assert Trial.begin(folder, new, "boot 2") == :ok
    assert Trial.status(folder, new) == :unvalidated
    refute Trial.on_trial_by_marker?(folder, new)
    assert Trial.put_notes(folder, ["required: sensor imu: was never good"]) == :ok

    # The power fails, heart or the watchdog restarts the board: the old one runs again.
    assert Trial.begin(folder, old, "boot 3") == :ok
    text = Findings.read(folder, :reverted)
    assert text =~ "by the board: a power cut, its watchdog or its heart"
    assert text =~ "nerves_fw_version new.0"
    assert text =~ "note: required: sensor imu: was never good"
    assert [line] = Enum.filter(Story.recent(folder), &(&1 =~ "was reverted"))
    assert line =~ "new.0"
    assert Trial.refused?(folder, "new")
    assert_receive {Memory, :prevent_revert}, 30_000

    # Once.
    File.rm!(Path.join(folder, "reverted.txt"))
    assert Trial.begin(folder, old, "boot 3") == :ok
    assert Trial.begin(folder, old, "boot 4") == :ok
    assert Findings.read(folder, :reverted) == nil
  end

  test "an image that never came as far as to say anything leaves a story", %{tmp_dir: folder} do
    old = firmware("old", "a", :validated)
    update(folder, old)
    assert Trial.begin(folder, old, "boot 2") == :ok
    assert Findings.read(folder, :reverted) =~ "before it could say that it had started"
  end

  test "an upload that failed is no revert", %{tmp_dir: folder} do
    old = firmware("old", "a", :validated)
    :ok = Trial.accepted(folder, old, "boot 1")
    assert Trial.begin(folder, old, "boot 1") == :ok
    assert Trial.begin(folder, old, "boot 2") == :ok
    assert Findings.read(folder, :reverted) == nil
    refute File.exists?(Path.join(folder, "trial.txt"))
  end

  test "the report of who has reverted stays", %{tmp_dir: folder} do
    old = firmware("old", "a", :validated)
    new = firmware("new", "b", :unvalidated)
    update(folder, old)
    :ok = Trial.begin(folder, new, "boot 2")
    assert Trial.revert(folder, new, "the keeper", ["it ended"]) == :ok
    assert_receive {Memory, :revert}
    assert Trial.begin(folder, old, "boot 3") == :ok
    assert Findings.read(folder, :reverted) =~ "by the keeper\n"
    assert Findings.read(folder, :reverted) =~ "note: it ended"
    assert Trial.refused?(folder, "new")
  end

  test "a board that has no fallback of its own has a trial by the guard", %{tmp_dir: folder} do
    # x86_64: once anything was validated there, the board says so for ever.
    for status <- [:unknown, :validated] do
      folder = Path.join(folder, "#{status}")
      old = firmware("old", "a", status)
      new = firmware("new", "b", status)
      update(folder, old)
      assert Trial.status(folder, old) == status

      assert Trial.begin(folder, new, "boot 2") == :ok
      assert Trial.status(folder, new) == :unvalidated
      assert Trial.on_trial_by_marker?(folder, new)
      assert Trial.validate(folder, new) == :ok
      refute_received {Memory, :validate}
      assert Trial.status(folder, new) == status

      assert Trial.begin(folder, new, "boot 3") == :ok
      assert Trial.status(folder, new) == status
      refute_received {Memory, :revert}
    end
  end

  test "such a board is reverted when the new firmware starts again and again without a verdict",
       %{
         tmp_dir: folder
       } do
    new = firmware("new", "b", :unknown)
    old = firmware("old", "a", :unknown)
    update(folder, old)
    for boot <- 2..4, do: :ok = Trial.begin(folder, new, "boot #{boot}")
    refute_received {Memory, :revert}
    assert Trial.begin(folder, new, "boot 5") == :ok
    assert_received {Memory, :revert}
    assert Findings.read(folder, :reverted) =~ "3 starts in vain"
    assert Trial.begin(folder, old, "boot 6") == :ok
    assert Trial.refused?(folder, "new")
  end

  test "firmware that was refused and works at last is refused no more", %{tmp_dir: folder} do
    old = firmware("old", "a", :validated)
    new = firmware("new", "b", :unvalidated)
    :ok = Trial.begin(folder, new, "boot 1")
    :ok = Trial.begin(folder, old, "boot 2")
    assert Trial.refused?(folder, "new")
    :ok = Trial.begin(folder, new, "boot 3")
    assert Trial.validate(folder, new) == :ok
    assert_received {Memory, :validate}
    refute Trial.refused?(folder, "new")
  end

  test "a board that does not answer is asked again, and nothing is lost meanwhile", %{
    tmp_dir: folder
  } do
    {Memory, memory} = old = firmware("old", "a", :validated)
    update(folder, old)
    Memory.answer(memory, :validation_status, {:error, :timeout})
    assert Trial.begin(folder, old, "boot 2") == {:error, :timeout}

    assert Trial.begin(folder, {BB.Firmware.Board.None, []}, "boot 2") ==
             {:error, :unknown_firmware}

    Memory.answer(memory, :validation_status, nil)
    assert Trial.begin(folder, old, "boot 2") == :ok
    eventually(fn -> Findings.read(folder, :reverted) end)
  end

  test "a folder that cannot be written to changes nothing of what the board says", %{
    tmp_dir: folder
  } do
    File.write!(Path.join(folder, "file"), "")
    folder = Path.join(folder, "file")
    old = firmware("old", "a", :validated)
    assert {:error, _} = Trial.accepted(folder, old, "boot 1")
    assert Trial.written(folder) == :ok
    assert Trial.begin(folder, old, "boot 2") == :ok
    assert Trial.status(folder, old) == :validated
    capture_log(fn -> assert Trial.validate(folder, old) == :ok end)
  end
end
